"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from diffprt.errors import InputError

_REMEDY = "choose a folder that you may write"


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it; raises InputError where it cannot."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be made ({error.strerror}): {_REMEDY}") from error


def write_whole(path: Path, content: bytes, what: str) -> Path:
    """Writes beside `path`, flushes to disk, renames, and flushes the folder: what is there then survives a crash.

    Args:
        path: the file, in a folder that exists; one that is there is replaced.
        content: its bytes.
        what: what the file is, for the message.

    Raises:
        InputError: the file cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with open(partial, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
        _flush(path.parent)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{what} {path} cannot be written ({error.strerror}): {_REMEDY}") from error
    return path


def _flush(folder: Path) -> None:
    """Puts the names in a folder on disk, where the system lets folders be opened."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
