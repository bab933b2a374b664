"""Asset files (.prt): safetensors with one JSON header; no pickle, bounds checked, self-contained."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

import safetensors
import safetensors.torch
import torch

from diffprt.errors import InputError
from diffprt.representation.geometry import with_geometry
from diffprt.representation.header import KEY, VERSION, header_text, read_header, torch_name, wrong_certificate
from diffprt.representation.interface import Representation
from diffprt.representation.provenance import Provenance
from diffprt.representation.registry import kind_of
from diffprt.representation.spec import Spec, mismatch, wrong_values
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
        InputError: the folder cannot be written, `asset` is of no type that is saved or has no geometry in 16 bits, it
            was made with what no file records (such as a BRDF of your own that holds a function), or `load` would
            refuse it: numbers that are not finite or out of range, another dtype, or settings that are not plain or too
            long.
    """
    path = Path(path)
    if not isinstance(asset, Representation):
        raise InputError(f"a {type(asset).__name__} cannot be saved: give a representation, such as bake returns")
    if asset.provenance.unsaved:
        raise InputError(f"asset {path} cannot be saved: {asset.provenance.unsaved}")
    asset = asset if geometry is None else with_geometry(asset, geometry)
    header = header_of(type(asset), asset.provenance)
    text = header_text(header)
    try:
        tensors = {
            key: tensor.detach().cpu().contiguous()
            for key, tensor in {**asset.stored(), **asset.elements.stored()}.items()
        }
        wrong = _wrong(type(asset), header, tensors)
    except InputError as error:
        raise InputError(f"asset cannot be saved: {error}") from error
    if wrong:
        raise InputError(f"asset cannot be saved: it {wrong}; put that right first")
    # A file has no two names for the same memory.
    first = {tensor.untyped_storage().data_ptr(): key for key, tensor in reversed(tensors.items())}
    apart = {
        key: tensor if first[tensor.untyped_storage().data_ptr()] == key else tensor.clone()
        for key, tensor in tensors.items()
    }
    data = safetensors.torch.save(apart, metadata={KEY: text})
    write_whole(path, data, "asset")
    return len(data)


def header_of(kind: type[Representation], provenance: Provenance) -> dict:
    """What a file says of an asset."""
    return {
        "version": VERSION,
        "type": kind.name,
        "conventions": {**CONVENTIONS, "transfer": kind.description},
        "scene_hash": provenance.scene_hash,
        "settings": provenance.settings,
        "plan": provenance.plan,
        "certificate": provenance.certificate,
    }


def _spec(kind: type[Representation], names: Collection[str]) -> Spec:
    return {**kind.spec, **kind.elements_type.file_spec(names)}


def _wrong(kind: type[Representation], header: dict, tensors: dict[str, torch.Tensor]) -> str | None:
    """What `load` would refuse, in words."""
    forms = {key: (tuple(t.shape), str(t.dtype).removeprefix("torch.")) for key, t in tensors.items()}
    return (
        wrong_certificate(header["certificate"])
        or _wrong_forms(kind, forms)
        or wrong_values(_spec(kind, tensors), tensors)
    )


def _wrong_forms(kind: type[Representation], forms: dict[str, tuple[tuple[int, ...], str]]) -> str | None:
    """What is wrong with the shapes and dtypes of tensors, in words."""
    shapes = {key: shape for key, (shape, _) in forms.items()}
    dtypes = {key: dtype for key, (_, dtype) in forms.items()}
    wrong = mismatch(_spec(kind, shapes), shapes, dtypes)
    if wrong is None:
        for key, shape in shapes.items():
            if math.prod(shape) > _LARGEST_TENSOR:
                return f"has {key} of shape {list(shape)}, over the limit of {_LARGEST_TENSOR} values"
    return wrong


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
    found = {key: (tuple(entry["shape"]), torch_name(entry["dtype"])) for key, entry in header["tensors"].items()}
    wrong = wrong_certificate(header["certificate"]) or _wrong_forms(kind, found)
    if wrong:
        raise InputError(f"asset {path} {wrong}: bake it again")
    try:
        tensors = safetensors.torch.load_file(path)
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"asset {path} is damaged ({str(error).splitlines()[0]}): bake it again") from error
    wrong = wrong_values(_spec(kind, tensors), tensors)
    if wrong:
        raise InputError(f"asset {path} {wrong}: bake it again")
    try:
        places = {name: tensors.pop(name) for name in kind.elements_type.file_spec(tensors) if name in tensors}
        provenance = Provenance(header["settings"], header["plan"], header["certificate"], header["scene_hash"])
        return kind.restored(tensors, kind.elements_type.restored(places), provenance)
    except InputError as error:
        raise InputError(f"asset {path} is inconsistent: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"asset {path} has a damaged header: bake it again") from error
