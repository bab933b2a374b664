"""`compress(bytes=)` and its command: the written file keeps and uses the budget; what is named is true."""

import json
import re

import pytest
import torch
from command_line import run

from diffprt.brdf import ModifiedPhong
from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.representation.files import load, save
from diffprt.scene import builtin_scene
from diffprt.transfer import bake, bake_glossy

FAST = {"method": "lbg", "iterations": 8}


@pytest.fixture(scope="module")
def assets(bumpy, bumpy_transfer):
    grey = bake(bumpy, order=4, rays=64, bounces=0)
    assert (grey.channels, bumpy_transfer.channels) == (1, 3)
    ball = builtin_scene("sphere", subdivisions=3)
    brdf = ModifiedPhong(6.0, diffuse=0.2, specular=0.7)
    return {
        "diffuse": grey,
        "colored": bumpy_transfer,
        "glossy": bake_glossy(ball, brdf, order=3, order_out=3, rays=48, bounces=0),
    }


@pytest.mark.parametrize("size", [27_000, 34_000, 52_000])
@pytest.mark.parametrize("kind", ["diffuse", "colored", "glossy"])
def test_the_file_keeps_the_budget_and_uses_it(assets, tmp_path, kind, size):
    report: dict = {}
    found = compress(assets[kind], clusters=16, bytes=size, report=report, **FAST)
    written = save(found, tmp_path / "a.prt")
    assert written == (tmp_path / "a.prt").stat().st_size <= size
    saturated = found.components == torch.Size(found.signal_shape).numel()
    assert written > 0.93 * size or saturated
    again = load(tmp_path / "a.prt")
    assert (again.components, again.weights_format) == (found.components, found.weights_format)
    assert report["form"]["components"] == found.components and found.settings["compress"]["bytes"] == size


def test_more_bytes_are_less_error_and_the_cheapest_loss_comes_first(assets):
    sizes = (26_000, 34_000, 50_000, 80_000, 200_000)
    found = [compress(assets["colored"], clusters=16, bytes=size, **FAST) for size in sizes]
    errors = [one.certificate["compression_relative"] for one in found]
    assert errors == sorted(errors, reverse=True) and errors[0] > 10 * errors[3]
    assert found[0].receivers.bits == 16 and found[0].openness is None
    assert found[2].receivers.bits == 16 and found[2].openness is not None and found[2].bent_normals is not None
    assert found[-1].receivers.bits == 32 and errors[-1] < 1e-3, "nothing is given up for nothing"
    whole = compress(assets["colored"], clusters=16, bytes=80_000, geometry=32, **FAST)
    assert whole.receivers.bits == 32 and torch.equal(whole.receivers.positions, assets["colored"].receivers.positions)


def test_fewer_clusters_where_they_leave_room(assets):
    """64 clusters of 81 numbers would take all of it."""
    found = compress(assets["glossy"], clusters=64, bytes=27_000, **FAST)
    assert found.clusters < 64 and found.components > 1


@pytest.mark.parametrize("kind", ["diffuse", "colored", "glossy"])
@pytest.mark.parametrize("geometry", [None, 32])
def test_the_least_that_is_named_is_the_least(assets, tmp_path, kind, geometry):
    options = {"clusters": 16, "geometry": geometry, **FAST}
    with pytest.raises(InputError, match="bytes is 5000, the least file takes") as caught:
        compress(assets[kind], bytes=5000, **options)
    least = int(re.search(r"takes (\d+)", str(caught.value))[1])
    assert least - 200 < save(compress(assets[kind], bytes=least, **options), tmp_path / "a.prt") <= least
    with pytest.raises(InputError, match=f"bytes is {least - 1}, the least file takes {least} "):
        compress(assets[kind], bytes=least - 1, **options)


def test_registers_and_bytes_are_not_both_chosen(assets):
    with pytest.raises(InputError, match="registers is given with bytes"):
        compress(assets["diffuse"], registers=64, bytes=50_000)


def test_sixteen_bits_on_request(assets, tmp_path, capsys):
    save(assets["diffuse"], tmp_path / "a.prt")
    out = tmp_path / "b.prt"
    assert run("compress", tmp_path / "a.prt", "--clusters", 4, "--geometry", 16, "-o", out) == 0
    text = capsys.readouterr().out
    assert re.search(r"b\.prt: file [\d.]+ KB, signal [\d.]+ KB \(was [\d.]+ KB\)", text)
    assert re.search(r"geometry in 16 bits \(positions move by at most [\de.-]+ units, [\de.-]+ of the box", text)
    assert load(out).receivers.bits == 16 and load(out).settings["compress"]["geometry"] == 16
    assert run("info", out) == 0
    assert "geometry in 16 bits (positions move by at most" in capsys.readouterr().out
    assert run("compress", tmp_path / "a.prt", "--geometry", 12, "-o", out) == 2
    assert "geometry is 12: give 16 or 32" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("diffuse", ("--clusters", 4, "--components", 1)),
        ("colored", ("--clusters", 8, "--components", 1, "--weights-format", "uint8", "--bases-format", "uint8")),
        ("colored", ("--clusters", 16, "--components", 2)),
        ("glossy", ("--clusters", 4, "--components", 1)),
        ("colored", ("--clusters", 16, "--bytes", "24KB")),
        ("glossy", ("--clusters", 16, "--bytes", "22000")),
    ],
)
def test_the_advice_brings_the_error_under_three_percent(assets, tmp_path, capsys, kind, options):
    save(assets[kind], tmp_path / "a.prt")
    out, report = tmp_path / "b.prt", tmp_path / "b.json"
    assert run("compress", tmp_path / "a.prt", *options, "-o", out, "--json", report) == 0
    found = json.loads(report.read_text())
    assert load(out).certificate["compression_relative"] > 0.03
    (line,) = re.findall(r"^warning: (.*)$", capsys.readouterr().out, re.MULTILINE)
    assert found["warnings"] == [line] and found["remedy"]["relative"] <= 0.03
    advised = re.search(r": ((?:--[\w-]+ \S+ ?)+)brings it to", line)[1].split()
    kept = [str(part) for part in options if "--bytes" not in advised or "--bytes" not in options]
    if "--bytes" in advised:
        kept = [str(part) for part in options[: options.index("--bytes")]]
    assert run("compress", tmp_path / "a.prt", *kept, *advised, "-o", out, "--json", report) == 0
    assert load(out).certificate["compression_relative"] <= 0.03
    assert out.stat().st_size <= found["remedy"]["file_bytes"]
    assert "warning" not in capsys.readouterr().out and json.loads(report.read_text())["warnings"] == []
