"""Glossy scenes on the command line: bake, render, info, and one clear line for every mistake."""

import json

import pytest
import torch
from command_line import run

from diffprt.compression import ClusteredGlossyTransfer
from diffprt.images import read_image
from diffprt.representation.files import load
from diffprt.transfer import GlossyTransfer

SMALL = ("--order", 3, "--rays", 64, "--bounces", 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A glossy asset and the report of its bake."""
    place = tmp_path_factory.mktemp("glossy")
    options = ("--brdf", "phong:exponent=16,specular=0.5", "--order-out", 4, "--threads", 1)
    assert (
        run("bake", "builtin:wall_and_floor", *SMALL, *options, "-o", place / "a.prt", "--json", place / "a.json") == 0
    )
    return place


def test_the_main_job_with_reports(folder, tmp_path, capsys):
    asset, report = load(folder / "a.prt"), json.loads((folder / "a.json").read_text())
    assert isinstance(asset, GlossyTransfer) and (asset.order, asset.order_out) == (3, 4)
    assert asset.settings == report["settings"]
    assert asset.settings["brdf"] == [{"name": "phong", "diffuse": 0.0, "specular": 0.5, "exponent": 16.0}]
    receivers = len(asset.receivers)
    assert report["counts"]["rays"] == receivers * (64 + 256) and report["counts"]["bytes"] == asset.nbytes
    assert report["timings"]["total"] > 0 and report["errors"] == asset.certificate
    size = (folder / "a.prt").stat().st_size
    assert report["outputs"]["bytes"] == size
    assert report["estimate"]["asset_bytes"] == pytest.approx(size, rel=0.2)
    pictures = []
    for azimuth in (20, 50):
        out, turned = tmp_path / f"{azimuth}.exr", ("--azimuth", azimuth, "--light-azimuth", azimuth)
        options = ("--light", "studio", "--size", 32, "--samples", 1, "--background", 0)
        assert run("render", folder / "a.prt", *options, *turned, "-o", out, "--json", tmp_path / "r.json") == 0
        pictures.append(read_image(out))
    counts = json.loads((tmp_path / "r.json").read_text())["counts"]
    assert counts["covered_pixels"] > 200 and counts["mean_radiance"] > 0
    assert float((pictures[0] - pictures[1]).abs().mean()) > 0.05 * float(pictures[0].abs().mean())
    capsys.readouterr()
    assert run("info", folder / "a.prt") == 0
    text = capsys.readouterr().out
    assert "glossy_transfer" in text and "16x9" in text and '"exponent": 16.0' in text


def test_the_same_bytes_for_any_number_of_threads(folder, tmp_path):
    options = ("--brdf", "phong:exponent=16,specular=0.5", "--order-out", 4, "--threads", 2)
    assert run("bake", "builtin:wall_and_floor", *SMALL, *options, "-o", tmp_path / "b.prt") == 0
    assert (tmp_path / "b.prt").read_bytes() == (folder / "a.prt").read_bytes()


def test_one_brdf_per_material(tmp_path):
    out = tmp_path / "a.prt"
    brdfs = ("--brdf", "ggx:roughness=0.5,specular=0.9,0.6,0.3", "--brdf", "lambert:diffuse=0.4")
    assert run("bake", "builtin:sphere", "--ground", *SMALL, *brdfs, "-o", out) == 0
    asset = load(out)
    assert asset.channels == 3 and [b["name"] for b in asset.settings["brdf"]] == ["ggx", "lambert"]


def test_dry_run_prints_and_does_nothing(tmp_path, capsys):
    report = tmp_path / "r.json"
    options = ("--brdf", "ggx", "--dry-run", "-o", tmp_path / "a.prt", "--json", report)
    assert run("bake", "builtin:wall_and_floor", *SMALL, *options) == 0
    text = capsys.readouterr().out
    for word in ("time", "memory", "asset", "receivers"):
        assert word in text
    assert not (tmp_path / "a.prt").exists()
    assert json.loads(report.read_text())["estimate"]["seconds"] > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--brdf", "shiny"), "brdf 'shiny': name 'shiny' is unknown: use one of lambert, phong"),
        (("--brdf", "phong:exponent=2e6"), "exponent is 2000000.0: give 0 to"),
        (("--brdf", "ggx:roughness=0"), "roughness is 0.0: give 0.001 to 1"),
        (("--brdf", "ggx", "--order-out", 11), "order 11 is outside 1..10"),
        (("--brdf", "ggx", "--bounces", "converged"), "bounces is 'converged'"),
        (("--brdf", "ggx", "--tolerance", 0.1), "tolerance is given with a BRDF"),
        (("--brdf", "ggx", "--seconds", 5), "seconds is given with a BRDF"),
        (("--brdf", "ggx", "--plan", "sky"), "plan is given with a BRDF"),
        (("--brdf", "ggx", "--albedo", 0.5), "albedo is given with a BRDF"),
        (("--brdf", "ggx", "--operator", "recompute"), "operator is given with a BRDF"),
        (("--brdf", "ggx", "--brdf", "phong", "--brdf", "ggx"), "3 BRDFs for 2 materials"),
        (("--brdf", "ggx", "--hours", 1e-7), "allow it with --hours 1"),
        (("--bounce-rays", 64), "bounce_rays is given, and no material"),
        (("--order-out", 3), "order_out is given, and no material of scene 'wall_and_floor' has a BRDF"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else None,
)
def test_mistakes_are_one_line(options, message, tmp_path, capsys):
    rays = () if {"--tolerance", "--seconds"} & set(options) else ("--rays", 64)
    assert run("bake", "builtin:wall_and_floor", "--order", 3, *rays, *options, "-o", tmp_path / "a.prt") == 2
    error = capsys.readouterr().err
    assert error.startswith("diffprt: ") and error.count("\n") == 1 and message in error
    assert list(tmp_path.iterdir()) == []


def test_too_large_for_memory(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1 << 20)
    assert run("bake", "builtin:wall_and_floor", "--brdf", "ggx", *SMALL, "-o", tmp_path / "a.prt") == 2
    error = capsys.readouterr().err
    assert "0.00 GiB are free: use a lower --order (now 3), a lower --order-out (now 3) or" in error
    assert list(tmp_path.iterdir()) == []


def test_interrupted_and_resumed(folder, tmp_path, capsys, monkeypatch):
    """Stopped in the bounce, as Ctrl-C does, and repeated: the bytes are those of a bake that was left alone."""
    from diffprt.transfer.glossy.passes import GlossyPasses

    bounce = GlossyPasses.bounce

    def stop(self, rows: range, transfer: torch.Tensor) -> torch.Tensor:
        # The trial before the bake bounces nothing, of stride 0.
        if transfer.stride(0) > 0:
            raise KeyboardInterrupt
        return bounce(self, rows, transfer)

    command = ("bake", "builtin:wall_and_floor", *SMALL, "--brdf", "phong:exponent=16,specular=0.5", "--order-out", 4)
    command = (*command, "-o", tmp_path / "a.prt", "--json", tmp_path / "a.json")
    with monkeypatch.context() as patched:
        patched.setattr(GlossyPasses, "bounce", stop)
        assert run(*command) == 130
    error, parts = capsys.readouterr().err, tmp_path / "a.prt.parts"
    assert error.count("\n") == 1 and f"are kept in {parts}: repeat the command to go on" in error
    assert [p.name for p in tmp_path.iterdir()] == ["a.prt.parts"]
    done = len(list(parts.glob("*.safetensors")))
    assert f"interrupted: {done} of" in error and done >= 1
    assert run(*command) == 0
    counts = json.loads((tmp_path / "a.json").read_text())["counts"]
    assert counts["resumed_chunks"] == done < counts["chunks"] and counts["recomputed_in_flight"] >= 1
    assert f"resumed: {done} of {counts['chunks']} chunks were done" in capsys.readouterr().out
    assert not parts.exists()
    assert (tmp_path / "a.prt").read_bytes() == (folder / "a.prt").read_bytes()


def test_compress_render_info(folder, tmp_path, capsys):
    out, report = tmp_path / "c.prt", tmp_path / "c.json"
    options = ("--clusters", 24, "--components", 6, "--registers", 64, "--weights-format", "uint8")
    assert run("compress", folder / "a.prt", *options, "-o", out, "--json", report) == 0
    assert "24 clusters x 6 components" in capsys.readouterr().out
    found, baked, counts = load(out), load(folder / "a.prt"), json.loads(report.read_text())["counts"]
    assert isinstance(found, ClusteredGlossyTransfer) and (found.order, found.order_out) == (3, 4)
    assert found.settings["brdf"] == baked.settings["brdf"] and found.settings["compress"]["registers"] == 64
    # 16 exit coefficients x 7 / 4 float4 a cluster: two fit into a pass.
    assert counts["passes"] == 12 and counts["bytes"] == found.nbytes < counts["bytes_before"] == baked.nbytes
    pictures = []
    for asset in (folder / "a.prt", out):
        picture, size = tmp_path / "p.exr", ("--size", 24, "--samples", 1, "--background", 0)
        assert run("render", asset, "--light", "studio", *size, "-o", picture) == 0
        pictures.append(read_image(picture))
    off = float((pictures[1] - pictures[0]).norm() / pictures[0].norm())
    assert 1e-4 < off < 0.2
    capsys.readouterr()
    assert run("info", out) == 0
    text = capsys.readouterr().out
    for word in ("clustered_glossy_transfer", "24x1x16x9", "24x6x1x16x9", '"compression_relative"', '"exponent": 16.0'):
        assert word in text


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("compress", "c.prt", "-o", "d.prt"), "c.prt is already compressed: give the one that 'diffprt bake' made"),
        (("compress", "a.prt", "-o", "d.prt", "--registers", 35), "holds no cluster, which needs 36"),
        (("compress", "a.prt", "-o", "d.prt", "--components", 65), "components is 65: give 0 to 64"),
        (("render", "c.prt", "-o", "d.png", "--light", "nowhere.hdr"), "nowhere.hdr"),
    ],
)
def test_mistakes_with_compressed_glossy_assets_are_one_line(folder, tmp_path, capsys, monkeypatch, command, message):
    (tmp_path / "a.prt").write_bytes((folder / "a.prt").read_bytes())
    monkeypatch.chdir(tmp_path)
    assert run("compress", "a.prt", "-o", "c.prt", "--clusters", 2, "--components", 1) == 0
    capsys.readouterr()
    assert run(*command) == 2
    error = capsys.readouterr().err
    assert error.startswith("diffprt: ") and error.count("\n") == 1 and message in error
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.prt", "c.prt"]
