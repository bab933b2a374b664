"""Asset files (.prt): safetensors with one JSON header; no pickle, bounds checked, self-contained."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import safetensors
import safetensors.torch
import torch

from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer
from diffprt.compression.clustered import storage
from diffprt.errors import InputError
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, Transfer
from diffprt.whole_file import write_whole

VERSION = 1
CONVENTIONS = {
    "sh": "real orthonormal, Condon-Shortley, index l(l+1)+m, polar axis +z",
    "space": "right-handed, +y up",
}
_DIFFUSE = "cosine times visibility plus interreflection, without own albedo and 1/pi"
_GLOSSY = (
    "light on the scene's axes to exit radiance on the receiver's own (z the normal, tangent by Duff et al. 2017), "
    "BRDF and cosine included"
)
_KEY = "diffprt"
_LARGEST_HEADER = 1 << 20
_LARGEST_TENSOR = 1 << 33

Asset = Transfer | ClusteredTransfer | GlossyTransfer | ClusteredGlossyTransfer


@dataclass(frozen=True)
class _Kind:
    """How one type of asset becomes tensors, and back; `shapes` and `optional` give each tensor's dtype and rank."""

    type: type
    transfer: str
    shapes: dict[str, tuple[tuple[torch.dtype, ...], int]]
    optional: dict[str, tuple[tuple[torch.dtype, ...], int]]
    pack: Callable[[Asset], dict[str, torch.Tensor]]
    unpack: Callable[[dict[str, torch.Tensor]], dict]


_FLOAT = (torch.float32, torch.float64)
_CODE = (*_FLOAT, torch.float16, torch.uint8)
_GEOMETRY = {
    "positions": ((torch.float32,), 2),
    "normals": ((torch.float32,), 2),
    "albedo": ((torch.float32,), 2),
    "faces": ((torch.int32,), 2),
}
_RANGES = {name: ((torch.float32,), 2) for name in storage.RANGES}
_OPENNESS = {"openness": ((torch.float32,), 1), "bent_normals": ((torch.float32,), 2)}


def _openness(asset: Transfer | ClusteredTransfer) -> dict[str, torch.Tensor]:
    return {key: getattr(asset, key) for key in _OPENNESS if getattr(asset, key) is not None}


def _unpack_clustered(tensors: dict[str, torch.Tensor]) -> dict:
    return {key: tensors[key] for key in _OPENNESS if key in tensors} | storage.from_tensors(tensors)


def _clustered_shapes(rank: int) -> dict[str, tuple[tuple[torch.dtype, ...], int]]:
    """Of clusters whose means have `rank` dimensions."""
    return {
        "labels": (storage.LABEL_TYPES, 1),
        "means": (_CODE, rank),
        "bases": (_CODE, rank + 1),
        "weights": (_CODE, 2),
    }


KINDS = {
    "transfer": _Kind(
        Transfer,
        _DIFFUSE,
        {"diffuse": (_FLOAT, 3)},
        _OPENNESS,
        lambda asset: {"diffuse": asset.diffuse} | _openness(asset),
        dict,
    ),
    "clustered_transfer": _Kind(
        ClusteredTransfer,
        _DIFFUSE,
        _clustered_shapes(3),
        _OPENNESS | _RANGES,
        lambda asset: storage.to_tensors(asset) | _openness(asset),
        _unpack_clustered,
    ),
    "glossy_transfer": _Kind(
        GlossyTransfer,
        _GLOSSY,
        {"glossy": (_FLOAT, 4)},
        {},
        lambda asset: {"glossy": asset.glossy},
        dict,
    ),
    "clustered_glossy_transfer": _Kind(
        ClusteredGlossyTransfer,
        _GLOSSY,
        _clustered_shapes(4),
        _RANGES,
        storage.to_tensors,
        storage.from_tensors,
    ),
}


def save(asset: Asset, path: str | Path) -> int:
    """Writes an asset to `path` (.prt); the file appears whole or not at all.

    Returns:
        its size in bytes.

    Raises:
        InputError: the folder cannot be written, or `asset` is of no type that is saved.
    """
    path = Path(path)
    name = next((name for name, kind in KINDS.items() if isinstance(asset, kind.type)), None)
    if name is None:
        raise InputError(
            f"a {type(asset).__name__} cannot be saved: give a {' or '.join(k.type.__name__ for k in KINDS.values())}"
        )
    receivers, kind = asset.receivers, KINDS[name]
    tensors = kind.pack(asset) | {
        "positions": receivers.positions,
        "normals": receivers.normals,
        "albedo": receivers.albedo,
        "faces": receivers.faces.to(torch.int32),
    }
    header = {
        "version": VERSION,
        "type": name,
        "conventions": {**CONVENTIONS, "transfer": kind.transfer},
        "scene_hash": asset.scene_hash,
        "settings": asset.settings,
        "plan": asset.plan,
        "certificate": asset.certificate,
    }
    data = safetensors.torch.save(
        {key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()},
        metadata={_KEY: json.dumps(header, sort_keys=True)},
    )
    write_whole(path, data, "asset")
    return len(data)


def read_header(path: str | Path) -> dict:
    """The JSON header of an asset, with each tensor's dtype and shape under "tensors"; reads no tensor.

    Raises:
        InputError: missing, unreadable, truncated, or not an asset of this version.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"asset {path} does not exist: give a .prt file, made by 'diffprt bake'")
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(_KEY)
            tensors = {key: file.get_slice(key) for key in file.keys()}  # noqa: SIM118
            shapes = {key: {"dtype": t.get_dtype(), "shape": t.get_shape()} for key, t in tensors.items()}
    except (safetensors.SafetensorError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"asset {path} is damaged or not an asset ({reason}): bake it again") from error
    if text is None or len(text) > _LARGEST_HEADER:
        raise InputError(f"asset {path} has no diffprt header: give a .prt file, made by 'diffprt bake'")
    try:
        header = json.loads(text)
        version, kind = header["version"], header["type"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"asset {path} has a damaged header: bake it again") from error
    if version != VERSION:
        raise InputError(f"asset {path} has version {version}, this diffprt reads {VERSION}: bake it again")
    if kind not in KINDS:
        raise InputError(f"asset {path} holds a '{kind}', known are {', '.join(KINDS)}: bake it again")
    return {**header, "tensors": shapes, "bytes": path.stat().st_size}


def read_tensor(path: str | Path, name: str) -> torch.Tensor | None:
    """One tensor of an asset, None where it has none of that name; reads no other.

    Raises:
        InputError: as `read_header`.
    """
    if name not in read_header(path)["tensors"]:
        return None
    try:
        with safetensors.safe_open(Path(path), framework="pt") as file:
            return file.get_tensor(name)
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"asset {path} is damaged ({str(error).splitlines()[0]}): bake it again") from error


def load(path: str | Path) -> Asset:
    """Reads an asset; the type that was saved is the type that comes back.

    Raises:
        InputError: missing, unreadable, truncated, hostile, or inconsistent.
    """
    path = Path(path)
    header = read_header(path)
    kind = KINDS[header["type"]]
    expected = kind.shapes | _GEOMETRY
    if not set(expected) <= set(header["tensors"]) <= set(expected | kind.optional):
        raise InputError(f"asset {path} holds {sorted(header['tensors'])}, wanted {sorted(expected)}: bake it again")
    expected |= kind.optional
    for key, entry in header["tensors"].items():
        if len(entry["shape"]) != expected[key][1]:
            raise InputError(f"asset {path} has {key} of shape {entry['shape']}: bake it again")
        if torch.Size(entry["shape"]).numel() > _LARGEST_TENSOR:
            raise InputError(f"asset {path} has {key} of {entry['shape']}, over the limit of {_LARGEST_TENSOR} values")
    try:
        tensors = safetensors.torch.load_file(path)
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"asset {path} is damaged ({str(error).splitlines()[0]}): bake it again") from error
    for key, tensor in tensors.items():
        if tensor.dtype not in expected[key][0]:
            raise InputError(
                f"asset {path} has {key} of dtype {tensor.dtype}, wanted {expected[key][0]}: bake it again"
            )
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
            raise InputError(f"asset {path} has non-finite {key}: bake it again")
    try:
        receivers = Receivers(
            tensors.pop("positions"),
            tensors.pop("normals"),
            tensors.pop("albedo"),
            tensors.pop("faces").to(torch.int64),
        )
        return kind.type(
            receivers=receivers,
            settings=dict(header["settings"]),
            plan=dict(header["plan"]),
            certificate=dict(header["certificate"]),
            scene_hash=str(header["scene_hash"]),
            **kind.unpack(tensors),
        )
    except InputError as error:
        raise InputError(f"asset {path} is inconsistent: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"asset {path} has a damaged header: bake it again") from error
