"""Asset files (.prt): safetensors with one JSON header; no pickle, bounds checked, self-contained."""

from __future__ import annotations

import json
from pathlib import Path

import safetensors
import safetensors.torch
import torch

from diffprt.errors import InputError
from diffprt.representation.geometry import with_geometry
from diffprt.representation.header import KEY, VERSION, read_header
from diffprt.representation.interface import Representation
from diffprt.representation.provenance import Provenance
from diffprt.representation.registry import kind_of
from diffprt.representation.spec import mismatch
from diffprt.whole_file import write_whole

CONVENTIONS = {
    "sh": "real orthonormal, Condon-Shortley, index l(l+1)+m, polar axis +z",
    "space": "right-handed, +y up",
}
_LARGEST_TENSOR = 1 << 33


def save(asset: Representation, path: str | Path, *, geometry: int | None = None) -> int:
    """Writes an asset to `path` (.prt); the file appears whole or not at all.

    Args:
        asset: any representation.
        path: of the file.
        geometry: 32, or 16: positions, normals, albedo and faces in 16 bits (`with_geometry`); the asset's own without.

    Returns:
        its size in bytes.

    Raises:
        InputError: the folder cannot be written, `asset` is of no type that is saved, or has no geometry in 16 bits.
    """
    path = Path(path)
    if not isinstance(asset, Representation):
        raise InputError(f"a {type(asset).__name__} cannot be saved: give a representation, such as bake returns")
    asset = asset if geometry is None else with_geometry(asset, geometry)
    tensors = {**asset.stored(), **asset.elements.stored()}
    tensors = {key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()}
    # A file has no two names for the same memory.
    first = {tensor.untyped_storage().data_ptr(): key for key, tensor in reversed(tensors.items())}
    apart = {
        key: tensor if first[tensor.untyped_storage().data_ptr()] == key else tensor.clone()
        for key, tensor in tensors.items()
    }
    data = safetensors.torch.save(apart, metadata={KEY: header_text(type(asset), asset.provenance)})
    write_whole(path, data, "asset")
    return len(data)


def header_text(kind: type[Representation], provenance: Provenance) -> str:
    """The JSON of a file's header."""
    header = {
        "version": VERSION,
        "type": kind.name,
        "conventions": {**CONVENTIONS, "transfer": kind.description},
        "scene_hash": provenance.scene_hash,
        "settings": provenance.settings,
        "plan": provenance.plan,
        "certificate": provenance.certificate,
    }
    return json.dumps(header, sort_keys=True)


def load(path: str | Path) -> Representation:
    """Reads an asset; the type that was saved is the type that comes back.

    Raises:
        InputError: missing, unreadable, truncated, hostile, inconsistent, or of a kind that is not known here.
    """
    path = Path(path)
    header = read_header(path)
    try:
        kind = kind_of(header["type"])
    except InputError as error:
        raise InputError(f"asset {path} cannot be read: {error}; 'diffprt info' describes it") from None
    places_spec = kind.elements_type.file_spec(header["tensors"])
    spec = {**kind.spec, **places_spec}
    shapes = {key: tuple(entry["shape"]) for key, entry in header["tensors"].items()}
    wrong = mismatch(spec, shapes)
    if wrong is not None:
        raise InputError(f"asset {path} {wrong}: bake it again")
    for key, shape in shapes.items():
        if torch.Size(shape).numel() > _LARGEST_TENSOR:
            raise InputError(f"asset {path} has {key} of {shape}, over the limit of {_LARGEST_TENSOR} values")
    try:
        tensors = safetensors.torch.load_file(path)
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"asset {path} is damaged ({str(error).splitlines()[0]}): bake it again") from error
    for key, tensor in tensors.items():
        if str(tensor.dtype).removeprefix("torch.") not in spec[key].dtypes:
            wanted = " or ".join(spec[key].dtypes)
            raise InputError(f"asset {path} has {key} of dtype {tensor.dtype}, wanted {wanted}: bake it again")
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
            raise InputError(f"asset {path} has non-finite {key}: bake it again")
    try:
        places = {name: tensors.pop(name) for name in places_spec if name in tensors}
        provenance = Provenance(header["settings"], header["plan"], header["certificate"], header["scene_hash"])
        return kind.restored(tensors, kind.elements_type.restored(places), provenance)
    except InputError as error:
        raise InputError(f"asset {path} is inconsistent: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"asset {path} has a damaged header: bake it again") from error
