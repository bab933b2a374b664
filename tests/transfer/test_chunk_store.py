"""Folders of chunks: whatever happened to them, a bake ends with the bytes of one that nothing happened to."""

import errno
import json
import os
import random
import resource
import shutil
import signal
from contextlib import contextmanager

import pytest
import safetensors.torch
import torch

from diffprt.brdf import GGX
from diffprt.errors import InputError
from diffprt.lock import lock_file, locked
from diffprt.representation.files import save
from diffprt.transfer import bake, discard_chunks

OPTIONS = {"order": 2, "rays": 4096, "bounces": 1}
GLOSSY = {"order": 2, "order_out": 2, "rays": 32, "bounces": 1, "bounce_rays": 32}
KINDS = ("diffuse", "glossy")


@pytest.fixture(scope="module")
def finished(bumpy, tmp_path_factory):
    """By kind: how it is baked, a folder with all its chunks, and the bytes of an undisturbed bake."""
    place = tmp_path_factory.mktemp("finished")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("diffprt.transfer.glossy.passes.RECEIVERS_PER_CHUNK", 128)
        for kind, scene, options in (
            ("diffuse", bumpy, OPTIONS),
            ("glossy", bumpy.with_brdf(GGX(0.5, specular=0.6)), GLOSSY),
        ):
            bake(scene, **options, checkpoint=place / kind)
            save(bake(scene, **options), place / f"{kind}.prt")
            found[kind] = scene, options, place / kind, (place / f"{kind}.prt").read_bytes()
        yield found


@pytest.fixture
def resumed(finished, tmp_path):
    """resumed(harm, kind) -> the report of a bake that goes on from chunks after `harm(folder)`: bytes are compared."""

    def go_on(harm, kind="diffuse", **options) -> dict:
        scene, given, chunks, undisturbed = finished[kind]
        folder, report = tmp_path / "parts", {}
        shutil.copytree(chunks, folder)
        harm(folder)
        save(bake(scene, **given, **options, checkpoint=folder, report=report), tmp_path / "resumed.prt")
        assert (tmp_path / "resumed.prt").read_bytes() == undisturbed
        again: dict = {}
        bake(scene, **given, checkpoint=folder, report=again)
        assert again["counts"]["resumed_chunks"] == again["counts"]["chunks"] and not again["counts"]["damaged_chunks"]
        return report

    return go_on


def chunks_of(folder) -> list:
    found = sorted(folder.glob("*.safetensors"))
    assert len(found) > 5
    return found


@pytest.mark.parametrize(("kind", "seed"), [("diffuse", 0), ("diffuse", 1), ("diffuse", 2), ("glossy", 3)])
def test_a_flipped_bit_in_every_chunk(kind, seed, resumed):
    """Hard case 45."""
    where = random.Random(seed)

    def flip(folder):
        for path in chunks_of(folder):
            content = bytearray(path.read_bytes())
            # Headers are short, and are where readers crash: every other flip is there.
            end = len(content) if where.random() < 0.5 else 300
            content[where.randrange(end)] ^= 1 << where.randrange(8)
            path.write_bytes(content)

    counts = resumed(flip, kind)["counts"]
    assert counts["damaged_chunks"] == counts["chunks"] and counts["resumed_chunks"] == 0


def exchange(folder):
    one, two, *_ = chunks_of(folder)
    one.rename(folder / "held")
    two.rename(one)
    (folder / "held").rename(two)


def shape(folder):
    """Well-formed, by nobody's hand, and of other shapes."""
    path = chunks_of(folder)[1]
    tensors = safetensors.torch.load(path.read_bytes())
    safetensors.torch.save_file({name: tensor[:1].clone() for name, tensor in tensors.items()}, path)


def later(folder):
    path = chunks_of(folder)[1]
    content = path.read_bytes()
    assert content.count(b"diffprt sealed 1") == 1
    path.write_bytes(content.replace(b"diffprt sealed 1", b"diffprt sealed 2"))


def grow(folder):
    """To more than fits into memory, with nothing on disk."""
    os.truncate(chunks_of(folder)[1], 1 << 40)


def pipe(folder):
    path = chunks_of(folder)[1]
    path.unlink()
    os.mkfifo(path)


def link(folder):
    path = chunks_of(folder)[1]
    path.unlink()
    path.symlink_to(folder / "nowhere")


HARMS = {
    "exchanged": (exchange, 2),
    "another shape": (shape, 1),
    "a later version": (later, 1),
    "grown": (grow, 1),
    "a pipe": (pipe, 1),
    "a link to nothing": (link, 1),
    **{
        f"cut to {size}": (lambda folder, size=size: os.truncate(chunks_of(folder)[1], size), 1)
        for size in (0, 1, 7, 8, 40, 130, 400)
    },
    "copied over another": (lambda folder: shutil.copy(*chunks_of(folder)[:2]), 1),
    "missing": (lambda folder: chunks_of(folder)[1].unlink(), 0),
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_harmed_chunk_is_traced_again(harm, resumed):
    done, damaged = HARMS[harm]
    assert resumed(done)["counts"]["damaged_chunks"] == damaged


@pytest.mark.parametrize("kind", KINDS)
def test_chunks_of_another_bake_are_not_adopted(kind, finished, resumed, tmp_path):
    """As a kill during clean-up left them: without their key, under the names that this bake gives its own."""
    scene, options, _, _ = finished[kind]
    bake(scene, **options, seed=1, checkpoint=tmp_path / "other")

    def replace(folder):
        for path in chunks_of(tmp_path / "other"):
            shutil.copy(path, folder)
        (folder / "job.json").unlink()

    counts = resumed(replace, kind)["counts"]
    assert counts["damaged_chunks"] == counts["chunks"]


@pytest.mark.parametrize(
    "content",
    [None, b"", b"[]", b"\xff\xfe", b'{"key": {}, "sha256": "00"}', b"[" * 100_000, b" " * (1 << 21), b"null", b"NaN"],
    ids=["missing", "empty", "a list", "not UTF-8", "another hash", "deep", "long", "null", "NaN"],
)
def test_a_damaged_key_is_written_again(content, resumed):
    """Chunks say themselves whose they are."""

    def harm(folder):
        (folder / "job.json").unlink() if content is None else (folder / "job.json").write_bytes(content)

    counts = resumed(harm)["counts"]
    assert counts["resumed_chunks"] == counts["chunks"]


def test_a_folder_of_other_work_is_refused_whole(finished, bumpy, tmp_path):
    _, options, chunks, _ = finished["diffuse"]
    folder = tmp_path / "parts"
    shutil.copytree(chunks, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match="other settings or another scene"):
        bake(bumpy, **options, seed=1, checkpoint=folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    old = {**json.loads((folder / "job.json").read_text())["key"], "version": 2}
    (folder / "job.json").write_text(json.dumps(old, sort_keys=True))
    with pytest.raises(InputError, match="other settings or another scene"):
        bake(bumpy, **options, checkpoint=folder)
    (folder / "job.json").unlink()
    (folder / "job.json").mkdir()
    with pytest.raises(InputError, match=r"job\.json is not a file"):
        bake(bumpy, **options, checkpoint=folder)
    with pytest.raises(InputError, match="File exists"):
        bake(bumpy, **options, checkpoint=tmp_path / "parts" / "000000.safetensors")


def test_a_chunk_that_is_a_folder_is_named(finished, bumpy, tmp_path):
    (tmp_path / "parts" / "000001.safetensors" / "mine").mkdir(parents=True)
    with pytest.raises(InputError, match=r"000001\.safetensors cannot be written") as refused:
        bake(bumpy, **OPTIONS, checkpoint=tmp_path / "parts")
    assert "\n" not in str(refused.value) and (tmp_path / "parts" / "000001.safetensors" / "mine").is_dir()


def test_strangers_in_the_folder_stay(bumpy, finished, resumed, tmp_path):
    folder = tmp_path / "parts"
    strangers = ("foo.begun", "notes.txt", "1.safetensors", "mine.safetensors")

    def add(folder):
        for name in strangers:
            (folder / name).write_text("mine")
        (folder / "999999.begun").touch()
        (folder / ".000001.safetensors.12.partial").write_bytes(b"half")

    assert resumed(add)["counts"]["recomputed_in_flight"] == 0
    assert not list(folder.glob(".*.partial"))
    discard_chunks(folder)
    assert {path.name: path.read_text() for path in folder.iterdir()} == dict.fromkeys(strangers, "mine")


def test_a_chunk_damaged_after_it_was_written_is_traced_again(finished, resumed, tmp_path):
    @contextmanager
    def harmful(text, total, done):
        yield lambda: None
        os.truncate(chunks_of(tmp_path / "parts")[2], 100)

    assert resumed(lambda folder: None, track=harmful)["counts"]["damaged_chunks"] == 1


def test_a_full_disk_is_one_line(bumpy, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("pathlib.Path.touch", full)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(InputError, match=r"chunk .* cannot be written \(File too large\)") as refused:
            bake(bumpy, **OPTIONS, checkpoint=tmp_path / "parts")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "\n" not in str(refused.value) and not list((tmp_path / "parts").glob("*partial"))


def killed_while_clearing(folder, at: int) -> bool:
    """Discards in a process that is killed before it removes its file number `at`; whether it came so far."""
    process = os.fork()
    if process == 0:
        removed, unlink = [0], os.unlink

        def counted(*arguments, **options):
            if removed[0] == at:
                os.kill(os.getpid(), signal.SIGKILL)
            removed[0] += 1
            unlink(*arguments, **options)

        os.unlink = counted
        try:
            discard_chunks(folder)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == -signal.SIGKILL


@pytest.mark.parametrize("at", [0, 1, 5, 100])
def test_a_kill_during_clean_up_leaves_nothing_that_is_adopted(at, finished, bumpy, tmp_path):
    """Hard case 45: the next bake there is another one."""
    _, options, chunks, _ = finished["diffuse"]
    folder = tmp_path / "parts"
    shutil.copytree(chunks, folder)
    assert killed_while_clearing(folder, at) == (at < 100)
    assert not folder.exists()
    report: dict = {}
    other = bake(bumpy, **options, seed=1, checkpoint=folder, report=report)
    assert torch.equal(other.diffuse, bake(bumpy, **options, seed=1).diffuse)
    assert report["counts"]["resumed_chunks"] == report["counts"]["damaged_chunks"] == 0
    discard_chunks(folder)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(finished, bumpy, tmp_path):
    folder = tmp_path / "parts"
    with (
        locked(folder, lock_file(folder)),
        pytest.raises(InputError, match=rf"parts is being written by another run \(process {os.getpid()}\)"),
    ):
        bake(bumpy, **OPTIONS, checkpoint=folder)
    bake(bumpy, **OPTIONS, checkpoint=folder)
    with locked(folder, lock_file(folder)), pytest.raises(InputError, match="another run"):
        discard_chunks(folder)
    assert (folder / "job.json").exists()
