"""Files that are being written, beside what they will be: named after their writers, removed once those are dead."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:
    fcntl = None

_PARTIAL = re.compile(r"\..*\.(\d{1,10})\.partial(\..*)?", re.DOTALL)
# They hold this much of a name, so that they are never too long where the name itself is not.
_STEM, _ENDING = 50, 8
# Looking for what killed writers left may take this share of the time.
_SHARE = 0.05
_looked: dict[Path, float] = {}


def partial_name(stem: str, ending: str = "") -> str:
    """What a file or folder is called while this process writes it; `ending` tells libraries the format."""
    return f".{stem[:_STEM]}.{os.getpid()}.partial{ending[:_ENDING]}"


def clean_partials(folder: Path) -> None:
    """Removes the partial files in a folder whose writers are dead; those of living ones stay."""
    begun = time.monotonic()
    if os.name != "posix" or begun < _looked.get(folder, 0.0):
        return
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _PARTIAL.fullmatch(entry.name)
            if found and not _alive(int(found[1])):
                with suppress(OSError):
                    _remove_unless_held(entry.path, folder=entry.is_dir(follow_symlinks=False))
    now = time.monotonic()
    _looked[folder] = now + (now - begun) / _SHARE


def _alive(process: int) -> bool:
    """Whether there is such a process here."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _remove_unless_held(path: str, *, folder: bool) -> None:
    """Removes a partial file or folder that no process holds, not even one of another machine or container."""
    handle = os.open(path, (os.O_RDONLY if folder else os.O_RDWR) | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if folder:
            shutil.rmtree(path)
        else:
            os.unlink(path)
    finally:
        os.close(handle)


@contextmanager
def held(path: Path) -> Iterator[int]:
    """A new, empty file, locked where the system can, so that `clean_partials` elsewhere sees its writer alive."""
    path.unlink(missing_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        _lock(handle)
        yield handle
    finally:
        os.close(handle)


@contextmanager
def held_folder(path: Path) -> Iterator[None]:
    """The same of a folder that is there."""
    if os.name != "posix":
        yield
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        _lock(handle)
        yield
    finally:
        os.close(handle)


def _lock(handle: int) -> None:
    if fcntl is not None:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
