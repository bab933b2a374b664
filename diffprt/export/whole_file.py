"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from diffprt.errors import InputError


def write_whole(path: Path, content: bytes, what: str) -> Path:
    """Writes beside `path` and renames; folders are made.

    Args:
        path: the file; one that is there is replaced.
        content: its bytes.
        what: what the file is, for the message.

    Raises:
        InputError: the folder cannot be made or the file not written.
    """
    folder = path.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"directory {folder} cannot be made ({error.strerror}): choose a folder that you may write"
        ) from None
    partial = folder / f".{path.stem}.{os.getpid()}.partial"
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(
            f"{what} {path} cannot be written ({error.strerror}): choose a folder that you may write"
        ) from None
    return path
