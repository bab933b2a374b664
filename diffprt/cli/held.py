"""Outputs that are a command's alone until it ends."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from diffprt.cli.terminal import print
from diffprt.lock import locked

_held: dict[Path, ExitStack] = {}


def hold_output(path: Path, file: Path) -> None:
    """Keeps other runs from `path` until `let_go`, by a lock on `file`; says so where the file system has none.

    Raises:
        InputError: another run holds it.
    """
    place = file.parent.resolve() / file.name
    if place in _held:
        return
    with ExitStack() as stack:
        stack.enter_context(locked(path, place, lambda line: print(f"note: {line}")))
        _held[place] = stack.pop_all()


def let_go() -> None:
    """Leaves all outputs to others."""
    while _held:
        _held.popitem()[1].close()
