"""One run at a time on one output, by a lock of the system's that dies with its process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from diffprt.errors import InputError

_MARK = b"diffprt "
# Beyond what the file holds: Windows lets nobody read the bytes that are locked.
_LOCKED_BYTE = 1 << 20


def lock_file(path: Path) -> Path:
    """The file whose lock stands for `path`: small, hidden, and gone once the run has ended, unless it was killed."""
    return path.with_name(f".{path.name}.lock")


@contextmanager
def locked(what: Path, file: Path, say: Callable[[str], object] = lambda line: None) -> Iterator[bool]:
    """Holds `what` while the block runs; a run that was killed holds nothing.

    Args:
        what: the output, for messages.
        file: the lock file, in a folder that exists. One with other content than ours is locked and left as it is.
        say: takes a line where the file system has no locks; the block runs without one.

    Yields:
        whether there is a lock.

    Raises:
        InputError: another run holds it.
    """
    try:
        handle = _take(file)
    except OSError as error:
        say(f"{what} cannot be locked ({error.strerror}): another run on it would not be noticed")
        yield False
        return
    if handle is None:
        raise InputError(
            f"{what} is being written by another run{_holder(file)}: wait until that has ended, or write elsewhere"
        )
    try:
        yield True
    finally:
        _let_go(file, handle)


def _take(file: Path) -> int | None:
    """A handle that has the lock, or None where another has."""
    while True:
        handle = os.open(file, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        try:
            if not _lock(handle):
                os.close(handle)
                return None
            # Whoever held it before may have taken the file away: a lock on that one stops nobody.
            if _is(file, handle):
                if _is_ours(handle):
                    os.ftruncate(handle, 0)
                    os.lseek(handle, 0, os.SEEK_SET)
                    os.write(handle, _MARK + f"{os.getpid()}\n".encode())
                return handle
        except OSError:
            with suppress(OSError):
                _remove(file, handle)
            os.close(handle)
            raise
        os.close(handle)


def _let_go(file: Path, handle: int) -> None:
    with suppress(OSError):
        _remove(file, handle)
    os.close(handle)


def _remove(file: Path, handle: int) -> None:
    """Takes the file away while it is locked, so that no two runs have one each."""
    if _is_ours(handle) and _is(file, handle):
        file.unlink()


def _is(file: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(file))
    except FileNotFoundError:
        return False


def _is_ours(handle: int) -> bool:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, len(_MARK)) in (b"", _MARK)


def _holder(file: Path) -> str:
    """Which process has it, where the file says so."""
    with suppress(OSError):
        mark, _, number = file.read_bytes()[:64].partition(b" ")
        if mark + b" " == _MARK and number.strip().isdigit():
            return f" (process {int(number)})"
    return ""


if os.name == "nt":
    import msvcrt

    def _lock(handle: int) -> bool:
        os.lseek(handle, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except PermissionError:
            return False
        return True
else:
    import fcntl

    def _lock(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
