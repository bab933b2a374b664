"""The command line as its users type it: the main job, and one clear line for every mistake."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from command_line import run

from diffprt.images import read_image, write_image
from diffprt.representation.files import load, save
from diffprt.scene import builtin_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A mesh, a map, a baked and a compressed asset."""
    place = tmp_path_factory.mktemp("cli")
    ball = builtin_scene("sphere", subdivisions=3).meshes[0]
    trimesh.Trimesh(ball.positions.numpy(), ball.faces.numpy(), process=False).export(place / "ball.ply")
    up = torch.linspace(2, 0.1, 32)[:, None, None].expand(32, 64, 3)
    write_image(place / "map.hdr", up.contiguous())
    assert run("bake", place / "ball.ply", "--quality", "draft", "--ground", "-o", place / "ball.prt") == 0
    assert run("compress", place / "ball.prt", "--clusters", 8, "--components", 4, "-o", place / "small.prt") == 0
    return place


def test_the_main_job_with_reports(folder, tmp_path, capsys):
    asset, small, page = tmp_path / "a.prt", tmp_path / "s.prt", tmp_path / "page"
    reports = {name: tmp_path / f"{name}.json" for name in ("bake", "compress", "render", "export", "info")}
    options = ("--order", 6, "--rays", 128, "--bounces", 2, "--albedo", "0.8,0.5,0.3")
    assert run("bake", folder / "ball.ply", *options, "-o", asset, "--json", reports["bake"]) == 0
    assert run("compress", asset, "--clusters", 16, "-o", small, "--json", reports["compress"]) == 0
    picture = tmp_path / "picture.png"
    lit = ("--light", folder / "map.hdr", "--size", "64x48")
    assert run("render", small, *lit, "-o", picture, "--json", reports["render"]) == 0
    assert run("export", small, "-o", page, "--json", reports["export"]) == 0
    assert run("info", small, "--json", reports["info"]) == 0
    image = read_image(picture)
    assert image.shape == (48, 64, 3) and 0.3 < float(image.amax()) <= 1
    assert 0.25 < float(image[16:32, 24:40].mean()) < 0.8, "mid-grey, not dark"
    assert (page / "index.html").stat().st_size > 20_000
    for name, file in reports.items():
        report = json.loads(file.read_text())
        assert report["command"] == name
        if name != "info":
            assert report["timings"] and report["counts"] and "errors" in report, name
            assert all(seconds >= 0 for seconds in report["timings"].values())
    assert load(asset).order == 6
    assert "2 bounces" not in capsys.readouterr().err


def test_demo_makes_its_pictures_and_its_page(tmp_path, capsys):
    assert run("demo", "-o", tmp_path / "demo", "--order", 3, "--rays", 32, "--bounces", 1) == 0
    text = capsys.readouterr().out
    sheet, page = tmp_path / "demo" / "contact_sheet.png", tmp_path / "demo" / "page" / "index.html"
    assert str(sheet) in text and str(page) in text and "visibility and first hits" in text
    picture = read_image(sheet)[..., :3]
    assert picture.shape[1] > 1.5 * picture.shape[0] and 0.2 < float(picture.mean()) < 0.8
    assert page.stat().st_size > 1_000_000
    assert load(tmp_path / "demo" / "bunny_compressed.prt").channels == 3


def test_dry_run_prints_and_does_nothing(folder, tmp_path, capsys):
    assert run("bake", folder / "ball.ply", "--dry-run", "-o", tmp_path / "a.prt", "--json", tmp_path / "r.json") == 0
    text = capsys.readouterr().out
    for word in ("time", "memory", "asset", "receivers"):
        assert word in text
    assert not (tmp_path / "a.prt").exists() and not list(tmp_path.glob("*.parts"))
    assert json.loads((tmp_path / "r.json").read_text())["estimate"]["seconds"] > 0


def test_quality_presets_differ(folder, tmp_path):
    orders = {}
    for quality in ("draft", "good"):
        report = tmp_path / f"{quality}.json"
        assert run("bake", folder / "ball.ply", "--quality", quality, "--dry-run", "--json", report) == 0
        orders[quality] = json.loads(report.read_text())["settings"]
    assert orders["draft"]["rays"] < orders["good"]["rays"] and orders["draft"]["order"] < orders["good"]["order"]


def test_renders_to_exr_and_behind_the_light(folder, tmp_path):
    out = tmp_path / "r.exr"
    common = ("--light", folder / "map.hdr", "--size", 32, "--background", "light", "--window", "hann")
    assert run("render", folder / "small.prt", *common, "-o", out) == 0
    image = read_image(out)
    assert image.shape == (32, 32, 3) and bool(torch.isfinite(image).all())
    # The map is bright above and dark below; so is the background.
    assert float(image[0].mean()) > float(image[-1].mean())


def test_a_turned_light_turns_the_picture(folder, tmp_path):
    pictures = []
    for angle in (0, 180):
        out = tmp_path / f"{angle}.exr"
        options = ("--light", "sky", "--light-azimuth", angle, "--size", 32, "--samples", 1, "-o", out)
        assert run("render", folder / "ball.prt", *options) == 0
        pictures.append(read_image(out))
    assert float((pictures[0] - pictures[1]).abs().mean()) > 0.02 * float(pictures[0].abs().mean())


def mistakes(folder, tmp_path):
    """Name, arguments, and what the one line must say."""
    (tmp_path / "text.ply").write_text("this is not a mesh\n")
    (tmp_path / "text.hdr").write_text("this is not a map\n")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "range.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    (tmp_path / "wide.hdr").write_bytes(b"")
    write_image(tmp_path / "square.exr", torch.ones(8, 8, 3))
    vertices = np.eye(3, dtype=np.float32)
    vertices[1, 1] = np.nan
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["f 1 2 3"]
    (tmp_path / "nan.obj").write_text("\n".join(lines))
    whole = (folder / "ball.prt").read_bytes()
    (tmp_path / "cut.prt").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "noise.prt").write_bytes(b"\xff" * 100)
    (tmp_path / "file").write_text("in the way")
    ball, baked, small = folder / "ball.ply", folder / "ball.prt", folder / "small.prt"
    out = tmp_path / "never.prt"
    return {
        "missing file": (("bake", tmp_path / "gone.ply", "-o", out), "gone.ply"),
        "a folder": (("bake", tmp_path, "-o", out), str(tmp_path)),
        "not a mesh": (("bake", tmp_path / "text.ply", "-o", out), "text.ply"),
        "unknown ending": (("bake", tmp_path / "file", "-o", out), "file"),
        "NaN vertices": (("bake", tmp_path / "nan.obj", "-o", out), "non-finite"),
        "indices out of range": (("bake", tmp_path / "range.obj", "-o", out), "range"),
        "empty mesh": (("bake", tmp_path / "empty.obj", "-o", out), "empty"),
        "up of a built-in scene": (("bake", "builtin:sphere", "--up", "z", "-o", out), "built in"),
        "unknown scene": (("bake", "builtin:teapot", "-o", out), "teapot"),
        "order 0": (("bake", ball, "--order", 0, "-o", out), "order 0"),
        "order 40": (("bake", ball, "--order", 40, "-o", out), "order 40"),
        "negative rays": (("bake", ball, "--rays", -4, "-o", out), "rays is -4"),
        "words for rays": (("bake", ball, "--rays", "many", "-o", out), "many"),
        "bad albedo": (("bake", ball, "--albedo", "red", "-o", out), "red"),
        "albedo above 1": (("bake", ball, "--albedo", "1.5", "-o", out), "1.5"),
        "bad quality": (("bake", ball, "--quality", "ultra", "-o", out), "ultra"),
        "bad up": (("bake", ball, "--up", "w", "-o", out), "w"),
        "threads 0": (("bake", ball, "--threads", 0, "-o", out), "threads is 0"),
        "wrong ending": (("bake", ball, "-o", tmp_path / "a.obj"), ".obj"),
        "output below a file": (("bake", ball, "-o", tmp_path / "file" / "a.prt"), "cannot be written"),
        "too much memory": (("bake", ball, "--rays", 4096, "--bounces", 4, "--ground", "-o", out), "GiB"),
        "no clusters": (("compress", baked, "--clusters", 0, "-o", out), "clusters is 0"),
        "compressed twice": (("compress", small, "-o", out), "already compressed"),
        "truncated asset": (("compress", tmp_path / "cut.prt", "-o", out), "cut.prt"),
        "hostile asset": (("info", tmp_path / "noise.prt"), "noise.prt"),
        "missing map": (("render", small, "--light", tmp_path / "gone.hdr", "-o", tmp_path / "n.png"), "gone.hdr"),
        "not a map": (("render", small, "--light", tmp_path / "text.hdr", "-o", tmp_path / "n.png"), "text.hdr"),
        "square map": (("render", small, "--light", tmp_path / "square.exr", "-o", tmp_path / "n.png"), "8 x 8"),
        "bad size": (("render", small, "--size", "big", "-o", tmp_path / "n.png"), "big"),
        "bad curve": (("render", small, "--curve", "film", "-o", tmp_path / "n.png"), "film"),
        "bad window": (("render", small, "--window", "rect", "-o", tmp_path / "n.png"), "rect"),
        "bad exposure": (("render", small, "--exposure", "bright", "-o", tmp_path / "n.png"), "bright"),
        "picture ending": (("render", small, "-o", tmp_path / "n.bmp"), ".bmp"),
        "page below a file": (("export", small, "-o", tmp_path / "file" / "page"), "cannot be written"),
        "report below a file": (("info", small, "--json", tmp_path / "file" / "r.json"), "cannot be written"),
        "unknown option": (("bake", "--rayz", 3), "rayz"),
        "unknown command": (("bakes",), "bakes"),
    }


NAMES = [
    "missing file", "a folder", "not a mesh", "unknown ending", "NaN vertices", "indices out of range",
    "empty mesh", "up of a built-in scene", "unknown scene", "order 0", "order 40", "negative rays",
    "words for rays", "bad albedo", "albedo above 1", "bad quality", "bad up", "threads 0", "wrong ending",
    "output below a file", "too much memory", "no clusters", "compressed twice", "truncated asset", "hostile asset",
    "missing map", "not a map", "square map", "bad size", "bad curve", "bad window", "bad exposure",
    "picture ending", "page below a file", "report below a file", "unknown option", "unknown command",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_every_mistake_is_one_clear_line(name, folder, tmp_path, capsys, monkeypatch):
    table = mistakes(folder, tmp_path)
    if name == "too much memory":
        monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1 << 20)
    assert set(table) == set(NAMES)
    arguments, wanted = table[name]
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()}
    assert run(*arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("diffprt: ") and captured.err.count("\n") == 1, captured.err
    assert wanted in captured.err and len(captured.err) < 500, captured.err
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()} == before, "nothing half-written"


def test_light_of_another_order_is_one_clear_line(folder):
    from diffprt import InputError, export
    from diffprt.scene import constant_light

    asset = load(folder / "small.prt")
    with pytest.raises(InputError, match="SH coefficients"):
        export(asset, folder / "page", lights={"flat": constant_light(1.0, asset.order + 1)})


def test_unknown_brdf_is_one_clear_line():
    from diffprt import InputError
    from diffprt.scene import Material

    with pytest.raises(InputError, match=r"BRDF .phong7..*lambert"):
        Material(0.5, brdf="phong7")


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX's")
def test_read_only_folder_is_one_clear_line(folder, tmp_path, capsys):
    # The superuser may write anywhere but among the kernel's own files.
    closed = Path("/proc") if os.geteuid() == 0 else tmp_path
    tmp_path.chmod(0o500)
    try:
        assert run("compress", folder / "ball.prt", "-o", closed / "a.prt") == 2
        assert "cannot be written" in capsys.readouterr().err
    finally:
        tmp_path.chmod(0o700)


def test_a_real_process_keeps_the_streams_apart(folder, tmp_path):
    command = [sys.executable, "-m", "diffprt"]
    good = subprocess.run([*command, "info", str(folder / "small.prt")], capture_output=True, text=True)
    assert good.returncode == 0 and good.stderr == "" and "clustered_transfer" in good.stdout
    bad = subprocess.run([*command, "info", str(tmp_path / "gone.prt")], capture_output=True, text=True)
    assert bad.returncode == 2 and bad.stdout == "" and bad.stderr.count("\n") == 1
    assert re.match(r"^diffprt: asset .*gone\.prt does not exist: give a \.prt file", bad.stderr)
    shown = subprocess.run([*command, "--version"], capture_output=True, text=True)
    assert re.match(r"^diffprt \d+\.\d+\.\d+$", shown.stdout.strip())


def test_doctor_finds_the_kernels(capsys):
    assert run("doctor") == 0
    shown = capsys.readouterr().out
    assert "Mrays/s" in shown
    openexr = re.search(r"OpenEXR +(?:\W +)?(\d+)\.(\d+)\.(\d+)", shown)
    assert openexr and tuple(map(int, openexr.groups())) >= (3, 4, 13), shown


def test_assets_may_be_replaced(folder, tmp_path):
    asset = load(folder / "ball.prt")
    save(asset, tmp_path / "a.prt")
    save(asset, tmp_path / "c.prt")
    assert run("compress", tmp_path / "a.prt", "--clusters", 4, "-o", tmp_path / "c.prt") == 0
    assert load(tmp_path / "c.prt").clusters == 4
    # Not what it is made of.
    assert run("compress", tmp_path / "a.prt", "--clusters", 4, "-o", tmp_path / "a.prt") == 2
    assert not load(tmp_path / "a.prt").compressed
