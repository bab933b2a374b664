"""Files that appear whole or not at all: the one way in which diffprt writes."""

from __future__ import annotations

import errno
import os
import re
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from diffprt.errors import InputError

try:
    import fcntl
except ImportError:
    fcntl = None

_REMEDIES = {
    errno.ENOSPC: "free some space, or write elsewhere",
    errno.EDQUOT: "free some space, or write elsewhere",
    errno.EFBIG: "allow larger files, or write elsewhere",
    errno.ENAMETOOLONG: "give a shorter name",
}
_REMEDY = "choose a folder that you may write"
# Partial files hold this much of a name, so that they are never too long where the name itself is not.
_SHOWN = 50
_PARTIAL = re.compile(r"\..*\.(\d{1,10})\.partial(\..*)?", re.DOTALL)
# Looking for what killed writers left may take this share of the time.
_SHARE = 0.05
_looked: dict[Path, float] = {}
_kept: ContextVar[dict[tuple[int, int], str]] = ContextVar("kept")


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it; raises InputError where it cannot."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be made ({error.strerror}): {_remedy(error)}") from error


def write_whole(path: Path, content: bytes | Callable[[Path], object], what: str) -> Path:
    """Writes beside `path`, flushes to disk, renames, and flushes the folder: what is there then survives a crash.

    Whatever fails, the file that was there stays, and nothing else is left. Partial files of writers that were killed
    are removed.

    Args:
        path: the file, in a folder that exists; one that is there is replaced, and so is a link.
        content: its bytes; or what writes them to the path that it is given, which has the same ending, and proves
            that they are there: libraries may say nothing of a full disk.
        what: what the file is, for the message.

    Raises:
        InputError: the file cannot be written, is none that can be replaced, or is kept (`keeping`).
    """
    check_target(path, what)
    clean_partials(path.parent)
    partial = path.with_name(f".{path.stem[:_SHOWN]}.{os.getpid()}.partial{path.suffix[:8]}")
    try:
        try:
            with _held(partial) as handle:
                if isinstance(content, bytes):
                    with open(handle, "wb", closefd=False) as file:
                        file.write(content)
                else:
                    content(partial)
                    if os.fstat(handle).st_size == 0:
                        raise OSError(errno.EIO, "nothing was written")
                os.fsync(handle)
            partial.replace(path)
            _flush(path.parent)
        except BaseException:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(f"{what} {path} cannot be written ({error.strerror}): {_remedy(error)}") from error
    return path


def check_target(path: Path, what: str) -> None:
    """Refuses a path that no file can have or replace, before any work.

    Raises:
        InputError: it is a folder, a pipe or a device, its name is too long or no text, or it is kept (`keeping`).
    """
    text = str(path)
    try:
        text.encode()
    except UnicodeEncodeError:
        shown = text.encode("utf-8", "backslashreplace").decode()
        raise InputError(f"{what} {shown} has a name that is not UTF-8: give another name") from None
    try:
        found = path.stat()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"{what} {path} cannot be written ({error.strerror}): {_remedy(error)}") from error
        return
    except ValueError as error:
        raise InputError(f"{what} {text!r} has a name that no file can have: give another name") from error
    if not stat.S_ISREG(found.st_mode):
        kind = "folder" if stat.S_ISDIR(found.st_mode) else "pipe" if stat.S_ISFIFO(found.st_mode) else "device"
        raise InputError(f"{what} {path} cannot be written (it is a {kind}): give the name of a file")
    kept = _kept.get({}).get((found.st_dev, found.st_ino))
    if kept is not None:
        raise InputError(f"{what} {path} cannot be written (it is {kept}, which is read): write elsewhere")


@contextmanager
def keeping(files: dict[Path, str]) -> Iterator[None]:
    """Refuses to write over `files`, each with what it is, while the block runs; those that do not exist are none."""
    found = {}
    for path, what in files.items():
        with suppress(OSError, ValueError):
            entry = path.stat()
            found[entry.st_dev, entry.st_ino] = what
    token = _kept.set({**_kept.get({}), **found})
    try:
        yield
    finally:
        _kept.reset(token)


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
                    _remove_unless_held(entry.path)
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


def _remove_unless_held(path: str) -> None:
    """Removes a partial file that no process holds, not even one of another machine or container."""
    handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.unlink(path)
    finally:
        os.close(handle)


@contextmanager
def _held(path: Path) -> Iterator[int]:
    """A new, empty file, locked where the system can, so that `clean_partials` elsewhere sees its writer alive."""
    path.unlink(missing_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        if fcntl is not None:
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield handle
    finally:
        os.close(handle)


def _remedy(error: OSError) -> str:
    return _REMEDIES.get(error.errno or 0, _REMEDY)


def _flush(folder: Path) -> None:
    """Puts the names in a folder on disk, where the system lets folders be opened."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
