"""Where finished chunks lie: in memory, or in a folder that outlives a kill, each known to be whole and of its job."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.lock import lock_file, locked
from diffprt.sealed_tensors import DamagedError, read_sealed, seal, unsealed
from diffprt.whole_file import write_whole

_VERSION = 3
_JOB = "job.json"
_LARGEST_JOB = 1 << 20
_BEGUN = re.compile(r"(\d{6,})\.begun")
_OURS = re.compile(r"job\.json|\d{6,}\.(safetensors|begun)|\.(job\.json|\d{6,}\.safetensors)\..*partial|\..*\.lock")

Chunk = dict[str, torch.Tensor]


class ChunkStore:
    """Finished chunks of one work, in a folder (or in memory, without one); a context that holds the folder.

    A work is known by its key; a folder of another one is refused rather than overwritten. Each chunk is a file that
    appears whole or not at all, and says of which work and which number it is. One that is damaged, of another work or
    of another number does not count as finished.

    Attributes:
        damaged: chunks whose files were such.

    Raises:
        InputError: on entering, the folder belongs to other work, is in use, or cannot be written.
    """

    def __init__(self, folder: Path | None, key: dict, chunks: int) -> None:
        self.folder, self.chunks = folder, chunks
        self.damaged: set[int] = set()
        self._key = {**key, "chunks": chunks, "version": _VERSION}
        self._job = _hash(self._key)
        self._memory: dict[int, Chunk] = {}
        self._finished: set[int] = set()
        self._held = ExitStack()

    def __enter__(self) -> ChunkStore:
        if self.folder is not None:
            with ExitStack() as held:
                self._open(self.folder, held)
                self._held = held.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def _open(self, folder: Path, held: ExitStack) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            alone = held.enter_context(locked(folder, lock_file(folder)))
            self._claim(folder)
        except OSError as error:
            raise InputError(f"folder {folder} cannot be written ({error.strerror}): write elsewhere") from error
        if alone:
            _clear_leftovers(folder)
            _delete(path for path in folder.glob(".*.partial") if _OURS.fullmatch(path.name))
        for chunk in range(self.chunks):
            if os.path.lexists(self._path(chunk)):
                self.damaged.add(chunk) if self._read(chunk) is None else self._finished.add(chunk)

    def _claim(self, folder: Path) -> None:
        """Writes the key, where none is or a damaged one: chunks say themselves whose they are."""
        job, text = folder / _JOB, json.dumps({"key": self._key, "sha256": self._job}, sort_keys=True)
        found = _read_job(job)
        if found is not None and found.get("sha256") != self._job:
            raise InputError(
                f"{folder} holds chunks of a bake with other settings or another scene: "
                "repeat that command to finish it, or delete the folder"
            )
        if found is None:
            write_whole(job, text.encode(), "chunks")

    def finished(self) -> list[int]:
        """Chunks that need no work, each read and found whole."""
        return sorted(self._finished)

    def in_flight(self) -> int:
        """Chunks that were begun and not finished: what an earlier run lost when it was killed."""
        if self.folder is None:
            return 0
        marks = (_BEGUN.fullmatch(path.name) for path in self.folder.glob("*.begun"))
        return sum(int(mark[1]) < self.chunks and int(mark[1]) not in self._finished for mark in marks if mark)

    def begin(self, chunk: int) -> None:
        """Marks a chunk as in flight."""
        if self.folder is not None:
            # Only a count depends on it: a full disk is told by the chunk itself.
            with suppress(OSError):
                (self.folder / f"{chunk:06d}.begun").touch()

    def write(self, chunk: int, tensors: Chunk) -> None:
        """Stores a finished chunk."""
        if self.folder is None:
            self._memory[chunk] = tensors
        else:
            path = self._path(chunk)
            # A pipe or a link in a chunk's place, in a folder of our own, is none of its work.
            if path.is_symlink() or (path.exists() and not path.is_file() and not path.is_dir()):
                path.unlink()
            write_whole(path, seal(tensors, self._owner(chunk)), "chunk")
            with suppress(OSError):
                (self.folder / f"{chunk:06d}.begun").unlink(missing_ok=True)
        self._finished.add(chunk)

    def take(self, chunk: int, compute: Callable[[int], object]) -> Chunk:
        """A finished chunk, which memory then no longer holds.

        Args:
            compute: writes the chunk again, where its file was damaged since.

        Raises:
            InputError: the disk does not give back what was written.
        """
        if self.folder is None:
            return self._memory.pop(chunk)
        content = self._read(chunk)
        if content is None:
            self.damaged.add(chunk)
            compute(chunk)
            content = self._read(chunk)
        if content is None:
            raise InputError(f"chunk {self._path(chunk)} does not read as it was written: use another disk")
        return unsealed(content)

    def left_by_interrupt(self) -> str:
        """What Ctrl-C leaves."""
        done = f"interrupted: {len(self._finished)} of {self.chunks} chunks were done"
        if self.folder is None:
            return f"{done}, and nothing is kept: give a checkpoint folder to go on from there"
        return f"{done}, and are kept in {self.folder}: repeat the command to go on"

    def _read(self, chunk: int) -> bytes | None:
        try:
            owner, _, content = read_sealed(self._path(chunk))
        except DamagedError:
            return None
        return content if owner == self._owner(chunk) else None

    def _owner(self, chunk: int) -> str:
        return f"{self._job}/{chunk}"

    def _path(self, chunk: int) -> Path:
        return self.folder / f"{chunk:06d}.safetensors"


def discard_chunks(folder: Path) -> None:
    """Removes a checkpoint folder, once the asset is safe; a folder that is not one is left alone.

    It is renamed first, so that a kill leaves nothing that a later run takes for its own, and the next run removes what
    is left. Files that bakes do not make stay, and the folder with them.

    Raises:
        InputError: another run is using the folder.
    """
    if not (folder / _JOB).is_file():
        _clear_leftovers(folder)
        return
    with locked(folder, lock_file(folder)):
        if not folder.is_symlink() and all(_is_ours(path) for path in folder.iterdir()):
            with suppress(OSError):
                folder.rename(folder.with_name(f".{folder.name}.{os.getpid()}.discarded"))
        _clear_leftovers(folder)
        if folder.is_dir():
            _empty(folder)


def _read_job(file: Path) -> dict | None:
    """The key of a folder and its hash; None where there is none, or a damaged one.

    Of an earlier version, or of something else: a dictionary without a hash.
    """
    if not os.path.lexists(file):
        return None
    if not file.is_file():
        raise InputError(f"{file} is not a file: move it away, or write elsewhere")
    if file.stat().st_size > _LARGEST_JOB:
        return None
    try:
        found = json.loads(file.read_bytes())
        whole = isinstance(found, dict) and ("sha256" not in found or found["sha256"] == _hash(found.get("key")))
    except (ValueError, RecursionError):
        return None
    return found if whole else None


def _hash(key: object) -> str:
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()


def _is_ours(path: Path) -> bool:
    """Whether bakes make files of this name, or folders of such files."""
    if path.is_dir() and not path.is_symlink():
        return (path / _JOB).is_file() and all(_is_ours(inside) for inside in path.iterdir())
    return _OURS.fullmatch(path.name) is not None


def _empty(folder: Path) -> None:
    """Deletes what is ours, the key last, and the folder if that was all."""
    inside = sorted(folder.iterdir(), key=lambda path: path.name == _JOB)
    for path in inside:
        if path.is_dir() and not path.is_symlink() and (path / _JOB).is_file():
            _empty(path)
    _delete(path for path in inside if not path.is_dir() and _OURS.fullmatch(path.name))
    with suppress(OSError):
        folder.rmdir()


def _delete(files: Iterator[Path]) -> None:
    for path in files:
        with suppress(OSError):
            path.unlink()


def _clear_leftovers(folder: Path) -> None:
    """Removes what runs that were killed while they cleared `folder` away had renamed."""
    name = re.compile(rf"\.{re.escape(folder.name)}\.\d+\.discarded")
    for path in folder.parent.glob(".*.discarded") if folder.parent.is_dir() else ():
        if name.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)
