"""An output that is an input, or another output, by whatever name, is refused before any work, and nothing changes."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import pytest
import torch

from diffprt.cli.main import main
from diffprt.images import write_image
from diffprt.optimization import make_references, save_references
from diffprt.representation.files import save
from diffprt.scene import Light

GLTF = {
    "asset": {"version": "2.0"},
    "buffers": [{"uri": "parts/mesh%20one.bin", "byteLength": 4}],
    "images": [{"uri": "tex.png"}, {"uri": "data:image/png;base64,AAAA"}],
}


@pytest.fixture(scope="module")
def made(tmp_path_factory, bumpy_transfer) -> Path:
    """An asset, a map, references and scene files of which none can be read: whatever reads them is work."""
    folder = tmp_path_factory.mktemp("paths")
    save(bumpy_transfer, folder / "a.prt")
    save(bumpy_transfer, folder / "t.prt")
    write_image(folder / "map.exr", torch.ones(4, 8, 3))
    light = Light(torch.eye(16)[:, :3] + 1)
    save_references(make_references(bumpy_transfer, [light], 2, width=48, height=24), folder / "refs")
    (folder / "s.gltf").write_text(json.dumps(GLTF))
    (folder / "parts").mkdir()
    (folder / "parts" / "mesh one.bin").write_bytes(b"data")
    (folder / "s.obj").write_text("mtllib s.mtl\n")
    (folder / "s.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 wood.png\n")
    (folder / "s.ply").write_text("ply\nformat ascii 1.0\ncomment TextureFile tex.png\nend_header\n")
    (folder / "s.usda").write_text("#usda 1.0\nasset inputs:file = @./wood.png@\n")
    (folder / "s.usdc").write_bytes(b"PXR-USDC")
    for name in ("tex.png", "wood.png"):
        write_image(folder / name, torch.ones(2, 2, 3))
    return folder


@pytest.fixture
def place(made, tmp_path, monkeypatch) -> Path:
    shutil.copytree(made, tmp_path / "in")
    monkeypatch.chdir(tmp_path / "in")
    Path("link.prt").symlink_to("a.prt")
    os.link("a.prt", "hard.prt")
    return tmp_path / "in"


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(arguments: list[str], capsys) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr()
    assert ended.value.code == 2 and said.out == "" and said.err.count("\n") == 1, said
    return said.err


SAME = [
    "compress a.prt -o a.prt",
    "compress a.prt -o ./a.prt",
    "compress a.prt -o ../in/a.prt",
    "compress a.prt -o link.prt",
    "compress link.prt -o a.prt",
    "compress hard.prt -o a.prt",
    "compress a.prt -o c.prt --json a.prt",
    "compress a.prt -o c.prt --json c.prt",
    "compress a.prt -o new/c.prt --json new/../new/c.prt",
    "compress a.prt -o c.prt --prior map.exr --json map.exr",
    "info a.prt --json hard.prt",
    "render a.prt -o map.exr --light map.exr",
    "render a.prt --json map.exr --light map.exr",
    "render a.prt --reference-set 2 -o refs --lights sky,refs/0001.exr",
    "render a.prt --reference-set 2 -o new --json new/references.json",
    "export a.prt -o new --light map.exr --json map.exr",
    "export a.prt -o new --versions direct=t.prt --json t.prt",
    "export a.prt -o new --uncompressed t.prt --json t.prt",
    "export a.prt -o new --json new/index.html",
    "optimize a.prt --references refs --target t.prt -o t.prt",
    "optimize a.prt --references refs -o x.prt --checkpoint x.prt",
    "optimize a.prt --references refs -o x.prt --checkpoint a.prt --resume",
    "optimize a.prt --references refs -o x.prt --json x.prt.checkpoint",
    "optimize a.prt --references refs -o x.prt --json refs/references.json",
    "optimize a.prt --references refs -o x.prt --json refs/0000.exr",
    "invert light a.prt --references refs -o refs/0000.exr",
    "invert albedo a.prt --references refs -o a.prt",
    "invert joint a.prt --references refs -o x.prt --json x.prt",
    "bake s.gltf --json s.gltf",
    "bake s.gltf --json tex.png",
    "bake s.gltf -o x.prt --json ./parts/../parts/mesh~one.bin",
    "bake s.obj --json s.mtl",
    "bake s.obj --json wood.png",
    "bake s.ply --json tex.png",
    "bake s.usda --json wood.png",
    "bake s.usdc --json wood.png",
    "bake builtin:sphere --occluder s.obj --json s.obj",
    "bake builtin:sphere --plan map.exr --json map.exr",
    "bake builtin:sphere -o x.prt --json x.prt.parts/job.json",
    "plan s.gltf --json parts/mesh~one.bin",
    "study reference s.gltf -o new --json tex.png",
    "study overdraw s.obj -o new --light map.exr --json map.exr",
    "study tolerance --data . -o new --json wood.png",
]


@pytest.mark.parametrize("command", SAME)
def test_the_same_file_twice_is_refused_before_work(command, place, capsys):
    before = snapshot(place)
    said = refused([part.replace("~", " ") for part in command.split()], capsys)
    assert "which is read" in said or "give two names" in said or "write it elsewhere" in said, said
    assert snapshot(place) == before


def test_names_that_differ_are_no_reason(place, capsys):
    """Reports beside results and in their folder, pictures beside inputs, and outputs that are there already."""
    for command in (
        "render a.prt -o out.png --size 8 --light sky --json refs/report.json",
        "render a.prt -o out.png --size 8 --light map.exr --json refs/report.json",
        "render a.prt --reference-set 1 -o set --size 8 --json set/report.json --lights sky",
        "compress a.prt -o c.prt --clusters 2 --components 1 --json c.json",
        "info c.prt --json c.json",
    ):
        with pytest.raises(SystemExit) as ended:
            main(command.split())
        assert ended.value.code == 0, capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["render", "a.prt", "-o", "x" * 252 + ".png"], "shorter name"),
        (["render", "a.prt", "--json", "x" * 256], "shorter name"),
        (["bake", "builtin:sphere", "-o", "x" * 250 + ".prt"], "shorter name"),
        (["optimize", "a.prt", "--references", "refs", "-o", "x" * 246 + ".prt"], "shorter name"),
        (["info", "x" * 300], "shorter one"),
        (["render", "a.prt", "-o", "pipe.png"], "is a pipe"),
        (["render", "a.prt", "--json", "pipe.png"], "is a pipe"),
        (["render", "a.prt", "--json", "/dev/full"], "is a device"),
        (["info", "a.prt", "--json", "refs"], "is a folder"),
        (["render", "a.prt", "-o", "a\udcff.png"], "not UTF-8"),
        (["info", "a\udcff.prt"], "not UTF-8"),
        (["export", "a.prt", "-o", "new", "--title", "a\udcff"], "not UTF-8"),
    ],
)
def test_names_that_cannot_be_are_refused_before_work(arguments, words, place, capsys):
    os.mkfifo("pipe.png")
    before = snapshot(place)
    assert words in refused(arguments, capsys)
    assert snapshot(place) == before


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files as Linux does")
@pytest.mark.parametrize(
    "command",
    [
        "render a.prt -o out.png --size 128",
        "render a.prt -o out.exr --size 64",
        "render a.prt --reference-set 1 -o set --size 64 --lights sky",
        "compress a.prt -o out.prt --clusters 2 --components 1",
        "export a.prt -o page",
        "invert albedo a.prt --references refs -o out.prt",
        "bake builtin:sphere -o out.prt --order 1 --bounces 0 --rays 16",
    ],
)
def test_on_a_full_disk_a_command_says_one_line_and_leaves_what_was_there(command, place, capsys):
    import resource
    import signal

    for name in ("out.png", "out.exr", "out.prt", "set/0000.exr", "set/references.json", "page/index.html"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(b"before")
    before, limit = snapshot(place), resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limit[1]))
        assert "cannot be written" in refused(command.split(), capsys)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, handler)
    # A bake that could not be saved is finished by the next run.
    after = {path: content for path, content in snapshot(place).items() if ".parts" not in str(path)}
    assert after == before
