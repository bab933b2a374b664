"""`diffprt export` with the files for engines."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from command_line import run
from face_colors import FaceColors, pack_face_colors
from representations import face_colors

from diffprt.compression import compress
from diffprt.exporters import pack
from diffprt.representation.files import save


def test_files_for_engines(bumpy_transfer, tmp_path, capsys) -> None:
    save(compress(bumpy_transfer, clusters=6, components=3), tmp_path / "ball.prt")
    folder, report = tmp_path / "out", tmp_path / "report.json"
    options = ["--glb", "--shaders", "--registers", "18", "--light", "constant", "--json", report]
    assert run("export", tmp_path / "ball.prt", "-o", folder, *options) == 0
    names = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    assert {"index.html", "scene.glb", "prt.three.js", "example.html"} <= names
    assert {"shaders/wgsl/clustered_diffuse.vert.wgsl", "shaders/hlsl/clustered_diffuse_passes.frag.hlsl"} <= names
    assert not any("glossy" in name for name in names), "shaders of other assets"
    assert "registers[18]" in (folder / "shaders" / "glsl" / "clustered_diffuse_passes.vert").read_text()
    written = json.loads(report.read_text())
    assert written["settings"]["registers"] == 18
    assert written["outputs"]["glb"]["bytes"] == (folder / "scene.glb").stat().st_size
    assert "example.html shows it with three.js" in capsys.readouterr().out


def test_three_is_not_promised_to_a_kind_that_it_does_not_draw(tmp_path, capsys) -> None:
    save(face_colors(), tmp_path / "faces.prt")
    with_equation = replace(pack_face_colors(face_colors()), equation="radiance = color light")
    pack.register(FaceColors, lambda asset: with_equation)
    try:
        assert run("export", tmp_path / "faces.prt", "-o", tmp_path, "--glb", "--light", "constant") == 0
    finally:
        pack.register(FaceColors, pack_face_colors)
    assert "no three.js module draws it yet" in capsys.readouterr().out
    assert (tmp_path / "scene.glb").is_file() and not (tmp_path / "example.html").exists()


def test_versions_to_compare_with(bumpy_transfer, tmp_path, capsys) -> None:
    save(bumpy_transfer, tmp_path / "ball.prt")
    save(compress(bumpy_transfer, clusters=6, components=3, iterations=2), tmp_path / "small.prt")
    save(compress(bumpy_transfer, clusters=3, components=1, iterations=2), tmp_path / "before.prt")
    given = ["--uncompressed", tmp_path / "ball.prt", "--before", tmp_path / "before.prt"]
    given += ["--versions", f"Direct={tmp_path / 'ball.prt'}", "--light", "constant"]
    assert run("export", tmp_path / "small.prt", "-o", tmp_path / "page", *given) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    assert all(f'"name": "{name}"' in page for name in ("Optimized", "Before", "Uncompressed", "Direct", "Unshadowed"))
    assert "geometry" in capsys.readouterr().out
    assert run("export", tmp_path / "small.prt", "-o", tmp_path / "page", "--versions", "Direct") == 2
    assert "give NAME=FILE" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("registers", "words"), [("1", "a register budget of 1 float4 holds no cluster"), ("9", "leave registers out")]
)
def test_registers_that_cannot_be(registers, words, bumpy_transfer, tmp_path, capsys) -> None:
    asset = bumpy_transfer if registers == "9" else compress(bumpy_transfer, clusters=3, components=3, iterations=2)
    save(asset, tmp_path / "ball.prt")
    assert run("export", tmp_path / "ball.prt", "-o", tmp_path, "--registers", registers, "--light", "constant") == 2
    assert words in capsys.readouterr().err
