"""Passes over receivers, cut into chunks: on threads, resumable, interruptible, reported.

A chunk is a pure function of the work, the pass, its own number and what the pass before left. Work is pickled by plain
values, and what is heavy (trees, kernels' arrays) is made again where it arrives: a chunk has the same bytes on any
thread of any process.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import ClassVar, Generic, NamedTuple, TypeVar

import torch

from diffprt.errors import InputError, Interrupted
from diffprt.kernels import run_chunks
from diffprt.progress import Track, timed, untracked
from diffprt.transfer.baking.chunk_store import Chunk, ChunkStore

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
    """Runs all passes; chunks that `folder` holds are not computed again, unless they are damaged or of other work.

    Returns:
        what the last pass leaves.

    Raises:
        InputError: the folder belongs to other work, is in use by another run or cannot be written, or gradients are
            asked for beside it.
        Interrupted: Ctrl-C.
    """
    if work.gradients and folder is not None:
        raise InputError(
            f"checkpoint is {folder}, and the scene asks for gradients, which files do not keep: give one of them"
        )
    total = sum(len(one.cut) for one in work.passes)
    with ChunkStore(folder, work.key, total) as store:
        return _run(work, store, threads, track, {} if report is None else report)


def _run(work: Work[Left], store: ChunkStore, threads: int, track: Track, report: dict) -> Left:
    timings, counts = report.setdefault("timings", {}), report.setdefault("counts", {})
    done = set(store.finished())
    for name, count in (
        ("chunks", store.chunks),
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
            left = work.join(number, (store.take(place, one) for place in here), left)
    counts["damaged_chunks"] = counts.get("damaged_chunks", 0) + len(store.damaged)
    assert left is not None, "work has at least one pass"
    return left
