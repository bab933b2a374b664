"""Files appear whole or not at all, on a full disk too, and what killed writers left is removed."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

import diffprt
from diffprt.errors import InputError
from diffprt.images import read_image, write_image
from diffprt.partial_files import partial_name
from diffprt.rendering.sheet import contact_sheet
from diffprt.study.rows import Rows, save_tensors
from diffprt.whole_file import check_target, keeping, write_together, write_whole

SOURCES = Path(diffprt.__file__).parent
IMAGE = torch.rand(200, 200, 3, generator=torch.Generator().manual_seed(0))


def dead_process() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


@pytest.fixture
def little_space():
    """Files of this process may have 8 KB: writes fail half-way, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


WRITERS = {
    "png": lambda folder: write_image(folder / "a.png", IMAGE),
    "exr": lambda folder: write_image(folder / "a.exr", IMAGE),
    "hdr": lambda folder: write_image(folder / "a.hdr", IMAGE),
    "bytes": lambda folder: write_whole(folder / "a.bin", bytes(100_000), "file"),
    "sheet": lambda folder: contact_sheet(folder / "sheet.png", [[IMAGE]], ["a"], ["b"]),
    "tensors": lambda folder: save_tensors(folder / "a.safetensors", {"x": IMAGE}),
    "rows": lambda folder: Rows(folder / "rows.jsonl").add("a", {"x": "x" * 10_000}),
    "silent": lambda folder: write_whole(folder / "a.bin", lambda path: None, "file"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_without_space_what_was_there_stays(name, tmp_path, little_space):
    for file in ("a.png", "a.exr", "a.hdr", "a.bin", "sheet.png", "a.safetensors", "rows.jsonl"):
        (tmp_path / file).write_bytes(b"before")
    with pytest.raises(InputError, match="cannot be written") as caught:
        WRITERS[name](tmp_path)
    assert "\n" not in str(caught.value)
    assert {file.read_bytes() for file in tmp_path.iterdir()} == {b"before"} and len(list(tmp_path.iterdir())) == 7


def test_every_writer_of_files_is_the_one():
    """No other module opens files to write, or hands a path to a library that does; folders of chunks have marks."""
    writing = re.compile(
        r"\.write_text\(|\.write_bytes\(|savefig\(|save_file\(|screenshot\(path|mkstemp|np\.save|(?<!safetensors\.)torch\.save\("
        r"|open\([^)]*[\"'][wax]b?\+?[\"']|ImageOutput"
    )
    found = {}
    for path in sorted(SOURCES.rglob("*.py")):
        lines = [line.strip() for line in path.read_text("utf-8").splitlines() if writing.search(line)]
        if lines:
            found[path.relative_to(SOURCES).as_posix()] = lines
    assert set(found) == {"images.py", "rendering/sheet.py", "whole_file.py"}
    assert found["rendering/sheet.py"] == ['figure.savefig(drawn, format="png")']
    assert len(found["images.py"]) == len(found["whole_file.py"]) == 1


def test_exr_has_the_same_bytes_at_any_time(tmp_path):
    write_image(tmp_path / "a.exr", IMAGE)
    time.sleep(1.1)
    write_image(tmp_path / "b.exr", IMAGE)
    content = (tmp_path / "a.exr").read_bytes()
    assert content == (tmp_path / "b.exr").read_bytes() and b"capDate" not in content and b"DateTime" not in content


@pytest.mark.parametrize("ending", [".png", ".exr", ".hdr"])
def test_names_as_long_as_can_be(ending, tmp_path):
    path = tmp_path / ("x" * (255 - len(ending)) + ending)
    write_image(path, IMAGE)
    assert read_image(path).shape == IMAGE.shape
    with pytest.raises(InputError, match="give a shorter name"):
        write_image(tmp_path / ("x" * (256 - len(ending)) + ending), IMAGE)
    assert list(tmp_path.iterdir()) == [path]


def test_partial_files_of_the_dead_are_removed_and_those_of_the_living_stay(tmp_path):
    dead, living = dead_process(), subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    stale = [f".a.prt.{dead}.partial", f".r.{dead}.partial.png", f".{'x' * 50}.{dead}.partial"]
    kept = [
        f".a.prt.{living.pid}.partial",
        f".b.{os.getpid()}.partial",
        "a.partial",
        f"a.{dead}.partial",
        ".a.x.partial",
    ]
    try:
        for name in (*stale, *kept):
            (tmp_path / name).write_bytes(b"half")
        (tmp_path / f".together.{dead}.partial").mkdir()
        (tmp_path / f".together.{dead}.partial" / "0000.exr").write_bytes(b"half")
        (tmp_path / f".held.{dead}.partial").write_bytes(b"half")
        with open(tmp_path / f".held.{dead}.partial", "rb") as held:
            # Of another container, whose process numbers say nothing here.
            fcntl = pytest.importorskip("fcntl")
            fcntl.flock(held, fcntl.LOCK_EX)
            write_whole(tmp_path / "a.bin", b"whole", "file")
        found = {path.name for path in tmp_path.iterdir()}
        assert found == {*kept, "a.bin", f".held.{dead}.partial"}
    finally:
        living.kill()


def test_what_a_killed_writer_leaves_is_removed_by_the_next(tmp_path):
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom diffprt.whole_file import write_whole\n"
        "def slow(path):\n    path.write_bytes(b'half')\n    print('begun', flush=True)\n    time.sleep(60)\n"
        "write_whole(Path(sys.argv[1]), slow, 'file')\n"
    )
    child = subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "a.bin")], stdout=subprocess.PIPE)
    assert child.stdout is not None and child.stdout.readline() == b"begun\n"
    write_whole(tmp_path / "b.bin", b"whole", "file")
    assert (tmp_path / f".a.{child.pid}.partial.bin").exists()
    child.send_signal(signal.SIGKILL)
    child.wait()
    time.sleep(0.1)
    write_whole(tmp_path / "b.bin", b"whole", "file")
    assert [path.name for path in tmp_path.iterdir()] == ["b.bin"]


def test_interrupts_leave_nothing(tmp_path):
    def interrupted(path: Path) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a.bin", interrupted, "file")
    assert not list(tmp_path.iterdir())


def test_links_are_replaced_and_what_they_led_to_stays(tmp_path):
    (tmp_path / "real.bin").write_bytes(b"real")
    (tmp_path / "link.bin").symlink_to("real.bin")
    write_whole(tmp_path / "link.bin", b"new", "file")
    assert (tmp_path / "link.bin").read_bytes() == b"new" and (tmp_path / "real.bin").read_bytes() == b"real"


def test_what_no_file_can_replace_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("/dev/null")
    (tmp_path / "read.bin").write_bytes(b"read")
    os.link(tmp_path / "read.bin", tmp_path / "hard.bin")
    for name, words in (("pipe", "a pipe"), ("folder", "a folder"), ("link", "a device"), ("a\udcff", "not UTF-8")):
        with pytest.raises(InputError, match=words) as caught:
            write_whole(tmp_path / name, b"x", "file")
        str(caught.value).encode()
    with keeping({tmp_path / "read.bin": "the scene", tmp_path / "missing": "nothing"}):
        with pytest.raises(InputError, match="it is the scene, which is read"):
            check_target(tmp_path / "hard.bin", "file")
        write_whole(tmp_path / "missing", b"x", "file")
    write_whole(tmp_path / "hard.bin", b"x", "file")
    assert (tmp_path / "read.bin").read_bytes() == b"read"


def test_files_that_belong_together_change_together(tmp_path):
    def refuse(path: Path) -> None:
        raise InputError("no")

    def put(content: bytes):
        return lambda path: write_whole(path, content, "file")

    write_together(tmp_path / "set", {"0": put(b"old"), "1": put(b"old"), "list": put(b"old")}, "set")
    with pytest.raises(InputError, match=r"^no$"):
        write_together(tmp_path / "set", {"0": put(b"new"), "1": refuse, "list": put(b"new")}, "set")
    assert [path.read_bytes() for path in sorted((tmp_path / "set").iterdir())] == [b"old"] * 3
    write_together(tmp_path / "set", {"0": put(b"new"), "list": put(b"new")}, "set")
    assert {p.name: p.read_bytes() for p in (tmp_path / "set").iterdir()} == {"0": b"new", "1": b"old", "list": b"new"}


def test_rows_survive_a_line_that_was_cut_off(tmp_path):
    (tmp_path / "rows.jsonl").write_text('{"key": "a", "row": {"x": 1}}\n{"key": "b", "ro')
    Rows(tmp_path / "rows.jsonl").add("c", {"x": 3})
    assert set(Rows(tmp_path / "rows.jsonl").rows) == {"a", "c"}
    assert all(json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines())


def test_partial_names_are_short():
    assert len(partial_name("ä" * 255, "." + "x" * 200).encode()) <= 143
