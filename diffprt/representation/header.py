"""What an asset file says of itself, read without torch: of any type, known here or not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from safetensors import SafetensorError, safe_open

from diffprt.errors import InputError
from diffprt.file_content import check_content, missing

if TYPE_CHECKING:
    import numpy as np

KEY = "diffprt"
VERSION = 1
_ENTRIES = {"type": str, "scene_hash": str, "settings": dict, "plan": dict, "certificate": dict, "conventions": dict}
_LARGEST = 1 << 20
_DEEPEST = 32


def read_header(path: str | Path) -> dict:
    """The JSON header of an asset, with each tensor's dtype and shape under "tensors"; reads no tensor.

    Raises:
        InputError: missing, unreadable, truncated, or not an asset of this version.
    """
    path = Path(path)
    wanted = "a .prt file, made by 'diffprt bake'"
    if path.is_dir():
        raise InputError(f"asset {path} does not exist as a file, it is a folder: give {wanted}")
    if not path.exists():
        raise missing(path, "asset", wanted)
    if path.is_file() and path.stat().st_size == 0:
        raise InputError(f"asset {path} is damaged or not an asset (it has 0 bytes): bake it again")
    check_content(path, "asset", (".prt",))
    try:
        with safe_open(path, framework="np") as file:
            text = (file.metadata() or {}).get(KEY)
            tensors = {key: file.get_slice(key) for key in file.keys()}  # noqa: SIM118
            shapes = {key: {"dtype": t.get_dtype(), "shape": t.get_shape()} for key, t in tensors.items()}
    except (SafetensorError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"asset {path} is damaged or not an asset ({reason}): bake it again") from error
    if text is None or len(text) > _LARGEST:
        raise InputError(f"asset {path} has no diffprt header: give a .prt file, made by 'diffprt bake'")
    damaged = InputError(f"asset {path} has a damaged header: bake it again")
    try:
        header = json.loads(text)
        version = header["version"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise damaged from error
    if version != VERSION:
        raise InputError(f"asset {path} has version {version}, this diffprt reads {VERSION}: bake it again")
    whole = all(isinstance(header.get(name), kind) for name, kind in _ENTRIES.items())
    if not (whole and _depth(header) <= _DEEPEST and all(name.isprintable() for name in (header["type"], *shapes))):
        raise damaged
    return {**header, "tensors": shapes, "bytes": path.stat().st_size}


def read_array(path: str | Path, name: str) -> np.ndarray:
    """One tensor of an asset, of a name and a type (F16, F32 or F64) that its header has; reads no other.

    Raises:
        InputError: the file is damaged.
    """
    try:
        with safe_open(Path(path), framework="np") as file:
            return file.get_tensor(name)
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"asset {path} has no readable {name} ({str(error).splitlines()[0]}): bake it again"
        ) from error


def _depth(value: object) -> int:
    """How deep lists and objects are nested; writers of JSON recurse, so it is bounded."""
    depth, level = 0, [value]
    while level:
        held = [list(v.values()) if isinstance(v, dict) else v for v in level if isinstance(v, dict | list)]
        depth, level = depth + 1, [item for items in held for item in items]
    return depth
