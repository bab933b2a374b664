"""Progress with time left, on a terminal; silence elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol, TextIO


class Track(Protocol):
    """A bar over `total` pieces of work, `done` of them finished: a context that yields what to call after each."""

    def __call__(self, text: str, total: int, done: int = 0) -> AbstractContextManager[Callable[[], object]]: ...


def untracked(text: str, total: int, done: int = 0) -> AbstractContextManager[Callable[[], object]]:
    """No progress display."""
    return nullcontext(lambda: None)


@contextmanager
def track(text: str, total: int, done: int = 0) -> Iterator[Callable[[], None]]:
    """Shows a bar that moves by one at each call of what it yields."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=_drawn_on()), transient=True) as progress:
        task = progress.add_task(text, total=total, completed=done)
        yield lambda: progress.advance(task)


@contextmanager
def status(text: str) -> Iterator[None]:
    """Shows a spinner while the block runs."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(file=_drawn_on()).status(Text(text)):
        yield


def _drawn_on() -> TextIO:
    """Standard error itself, where a stream that lets no control character pass stands before it."""
    return getattr(sys.stderr, "beneath", sys.stderr)


@contextmanager
def timed(timings: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the seconds that the block takes."""
    begun = time.perf_counter()
    try:
        yield
    finally:
        timings[stage] = timings.get(stage, 0.0) + time.perf_counter() - begun
