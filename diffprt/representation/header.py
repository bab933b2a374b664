"""What an asset file says of itself, read without torch: of any type, known here or not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from safetensors import SafetensorError, safe_open

from diffprt.errors import InputError
from diffprt.file_content import check_content, missing
from diffprt.representation.plain import check_plain, parse_plain

if TYPE_CHECKING:
    import numpy as np

KEY = "diffprt"
VERSION = 1
_ENTRIES = {"type": str, "scene_hash": str, "settings": dict, "plan": dict, "certificate": dict, "conventions": dict}
_LARGEST = 1 << 20
_LONGEST = 128
_LETTERS = {"BF": "bfloat", "F": "float", "U": "uint", "I": "int"}
_REMEDY = "bake it again"
# Entries of a certificate that begin so are measured: numbers, which rooms compute with.
_MEASURED = (
    "noise_", "signal_", "expected_", "estimated_", "receivers_", "compression_", "convergence_", "optimized_",
    "geometry_", "rays_",
)  # fmt: skip


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
    header = parse_plain(text, f"asset {path} has a damaged header: it", _REMEDY)
    version = header.get("version") if isinstance(header, dict) else None
    if type(version) is int and version != VERSION:
        raise InputError(f"asset {path} has version {version}, this diffprt reads {VERSION}: bake it again")
    wrong = "" if type(version) is int else "no version"
    wrong = wrong or wrong_header(header) or next((f"a tensor {n!a}" for n in shapes if not n.isprintable()), "")
    if wrong:
        raise InputError(f"asset {path} has a damaged header ({wrong}): bake it again")
    return {**header, "tensors": shapes, "bytes": path.stat().st_size}


def header_text(header: dict) -> str:
    """The text that a file has for a header, if `read_header` takes it.

    Raises:
        InputError: it does not, and why.
    """
    what, remedy = "asset cannot be saved: its header", "leave that out, or make it plain"
    check_plain(header, what, remedy)
    if wrong := wrong_header(header):
        raise InputError(f"{what} has {wrong}: {remedy}")
    text = json.dumps(header, sort_keys=True)
    if len(text) > _LARGEST:
        longest = max(_ENTRIES, key=lambda name: len(json.dumps(header[name])))
        raise InputError(
            f"{what} has {len(text)} characters, most of them {longest}, at most {_LARGEST} are read again: shorten it"
        )
    return text


def wrong_header(header: dict) -> str:
    """What is wrong with a header of plain values, in words; "" where nothing is."""
    for name, kind in _ENTRIES.items():
        if not isinstance(header.get(name), kind):
            found = f"a {type(header[name]).__name__}" if name in header else "missing"
            return f"{name} is {found}, wanted a {kind.__name__}"
    for name in ("type", "scene_hash"):
        if len(header[name]) > _LONGEST or not header[name].isprintable():
            return f"{name} is no text of at most {_LONGEST} printable characters"
    return ""


def wrong_certificate(certificate: dict) -> str:
    """What is wrong with the numbers of a certificate, in words; "" where nothing is."""
    for name, value in certificate.items():
        if name.startswith(_MEASURED) and (isinstance(value, bool) or not isinstance(value, int | float)):
            return f"has {name} of its certificate as a {type(value).__name__}, wanted a number"
    return ""


def torch_name(dtype: str) -> str:
    """What torch calls a dtype of a file."""
    letters = dtype.rstrip("0123456789")
    return f"{_LETTERS.get(letters, letters.lower())}{dtype[len(letters) :]}"


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
