"""Passes over receivers, cut into chunks: on threads, resumable, interruptible, reported.

A chunk is a pure function of the work, the pass, its own number and what the pass before left. Work is pickled by plain
values, and what is heavy (trees, kernels' arrays) is made again where it arrives: a chunk has the same bytes on any
thread of any process.
"""

from __future__ import annotations

import json
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import ClassVar, Generic, NamedTuple, TypeVar

import safetensors.torch
import torch

from diffprt.errors import InputError, Interrupted
from diffprt.kernels import run_chunks
from diffprt.progress import Track, timed, untracked
from diffprt.whole_file import write_whole

_VERSION = 2
Chunk = dict[str, torch.Tensor]
Left = TypeVar("Left")


class Pass(NamedTuple):
    """One pass: what it is called in timings and by progress, and the rows of its chunks."""

    stage: str
    text: str
    cut: list[range]


class Work(ABC, Generic[Left]):
    """What passes compute.

    Attributes:
        passes: in their order; the cut does not depend on the number of threads.
        key: plain values by which a folder of chunks knows its work.
        gradients: whether results carry some, which files do not keep.
        heavy: names of cached properties that are made again where the work is unpickled.
    """

    passes: tuple[Pass, ...]
    key: dict
    gradients: bool = False
    heavy: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def ready(self, threads: int) -> None:
        """Makes what is heavy, before threads share it."""

    @abstractmethod
    def chunk(self, number: int, index: int, before: Left | None) -> Chunk:
        """Chunk `index` of pass `number`, given what `join` made of the pass before (None before the first)."""

    @abstractmethod
    def join(self, number: int, chunks: Iterator[Chunk], before: Left | None) -> Left:
        """What pass `number` leaves, from its chunks in order; each is dropped as the next is taken."""

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name not in self.heavy}


def run_passes(
    work: Work[Left],
    *,
    threads: int,
    folder: Path | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> Left:
    """Runs all passes; chunks that `folder` holds are not computed again.

    Returns:
        what the last pass leaves.

    Raises:
        InputError: the folder belongs to other work or cannot be written, or gradients are asked for beside it.
        Interrupted: Ctrl-C.
    """
    if work.gradients and folder is not None:
        raise InputError(
            f"checkpoint is {folder}, and the scene asks for gradients, which files do not keep: give one of them"
        )
    report = {} if report is None else report
    timings, counts = report.setdefault("timings", {}), report.setdefault("counts", {})
    total = sum(len(one.cut) for one in work.passes)
    store = ChunkStore(folder, work.key, total)
    done = set(store.finished())
    for name, count in (
        ("chunks", total),
        ("resumed_chunks", len(done)),
        ("recomputed_in_flight", store.in_flight()),
    ):
        counts[name] = counts.get(name, 0) + count
    work.ready(threads)
    left: Left | None = None
    first = 0
    for number, (stage, text, cut) in enumerate(work.passes):
        here = range(first, first + len(cut))
        first += len(cut)

        def one(place: int, number: int = number, start: int = here.start, before: Left | None = left) -> None:
            store.begin(place)
            # Threads begin with gradients enabled, whatever their parent has.
            with torch.set_grad_enabled(work.gradients):
                store.write(place, work.chunk(number, place - start, before))

        missing = [place for place in here if place not in done]
        with (
            timed(timings, stage),
            track(text, len(cut), len(cut) - len(missing)) as advance,
            closing(run_chunks(one, missing, threads=threads)) as running,
        ):
            try:
                for _ in running:
                    advance()
            except KeyboardInterrupt:
                running.close()
                raise Interrupted(store.left_by_interrupt()) from None
        with timed(timings, "gathering chunks"):
            left = work.join(number, (store.take(place) for place in here), left)
    assert left is not None, "work has at least one pass"
    return left


class ChunkStore:
    """Finished chunks of one work, in a folder (or in memory, without one).

    A work is known by its key; a folder left by another one is refused rather than overwritten. Each chunk is a file
    that appears whole or not at all.
    """

    def __init__(self, folder: Path | None, key: dict, chunks: int) -> None:
        self.folder, self.chunks = folder, chunks
        self._memory: dict[int, Chunk] = {}
        if folder is not None:
            self._open(folder, json.dumps({**key, "chunks": chunks, "version": _VERSION}, sort_keys=True))

    def _open(self, folder: Path, text: str) -> None:
        job = folder / "job.json"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not job.exists():
                write_whole(job, text.encode(), "chunks")
            elif job.read_text() != text:
                raise InputError(
                    f"{folder} holds chunks of a bake with other settings or another scene: "
                    "repeat that command to finish it, or delete the folder"
                )
        except OSError as error:
            raise InputError(f"folder {folder} cannot be written ({error.strerror}): write elsewhere") from error

    def finished(self) -> list[int]:
        """Chunks that need no work; damaged files do not count."""
        if self.folder is None:
            return sorted(self._memory)
        return [chunk for chunk in range(self.chunks) if self._path(chunk).exists()]

    def in_flight(self) -> int:
        """Chunks that were begun and not finished: what an earlier run lost when it was killed."""
        if self.folder is None:
            return 0
        return sum(not self._path(int(mark.stem)).exists() for mark in self.folder.glob("*.begun"))

    def begin(self, chunk: int) -> None:
        """Marks a chunk as in flight."""
        if self.folder is not None:
            (self.folder / f"{chunk:06d}.begun").touch()

    def write(self, chunk: int, tensors: Chunk) -> None:
        """Stores a finished chunk."""
        if self.folder is None:
            self._memory[chunk] = tensors
            return
        content = safetensors.torch.save({name: tensor.contiguous() for name, tensor in tensors.items()})
        write_whole(self._path(chunk), content, "chunk")
        (self.folder / f"{chunk:06d}.begun").unlink(missing_ok=True)

    def take(self, chunk: int) -> Chunk:
        """A finished chunk, which memory then no longer holds."""
        if self.folder is None:
            return self._memory.pop(chunk)
        return safetensors.torch.load(self._path(chunk).read_bytes())

    def left_by_interrupt(self) -> str:
        """What Ctrl-C leaves."""
        done = f"interrupted: {len(self.finished())} of {self.chunks} chunks were done"
        if self.folder is None:
            return f"{done}, and nothing is kept: give a checkpoint folder to go on from there"
        return f"{done}, and are kept in {self.folder}: repeat the command to go on"

    def _path(self, chunk: int) -> Path:
        return self.folder / f"{chunk:06d}.safetensors"


def discard_chunks(folder: Path) -> None:
    """Removes a checkpoint folder, once the asset is safe; a folder that is not one is left alone."""
    if (folder / "job.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
