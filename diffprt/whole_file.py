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
    """Writes beside `path` and renames.

    Args:
        path: the file, in a folder that exists; one that is there is replaced.
        content: its bytes.
        what: what the file is, for the message.

    Raises:
        InputError: the file cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{what} {path} cannot be written ({error.strerror}): {_REMEDY}") from error
    return path
