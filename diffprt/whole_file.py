"""Files that appear whole or not at all: the one way in which diffprt writes."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from diffprt.errors import InputError
from diffprt.partial_files import clean_partials, held, held_folder, partial_name

_REMEDIES = {
    errno.ENOSPC: "free some space, or write elsewhere",
    errno.EDQUOT: "free some space, or write elsewhere",
    errno.EFBIG: "allow larger files, or write elsewhere",
    errno.ENAMETOOLONG: "give a shorter name",
}
_REMEDY = "choose a folder that you may write"
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
    partial = path.with_name(partial_name(path.stem, path.suffix))
    try:
        try:
            with held(partial) as handle:
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


def write_together(folder: Path, writers: Mapping[str, Callable[[Path], object]], what: str) -> None:
    """Writes files of one folder that belong together: until all of them are on disk, those that were there stay.

    The last one vouches for the others: it is removed before the first of them changes, and comes when all are there.

    Args:
        folder: made if missing.
        writers: by name, what writes a file to the path that it is given, whole or not at all.
        what: what they are, for messages.

    Raises:
        InputError: one cannot be written, or is none that can be replaced.
    """
    make_folder(folder)
    for name in writers:
        check_target(folder / name, what)
    clean_partials(folder)
    partial = folder / partial_name("together")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        try:
            with held_folder(partial):
                for name, write in writers.items():
                    write(partial / name)
            (folder / list(writers)[-1]).unlink(missing_ok=True)
            for name in writers:
                (partial / name).replace(folder / name)
            _flush(folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{what} {folder} cannot be written ({error.strerror}): {_remedy(error)}") from error


def check_target(path: Path, what: str, *, folder: bool = False) -> None:
    """Refuses a path that no file can have or replace, before any work.

    Args:
        what: what it is, for the message.
        folder: a folder is fine too.

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
    if not (stat.S_ISREG(found.st_mode) or (folder and stat.S_ISDIR(found.st_mode))):
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
