"""What describes a BRDF: checked, so that no parameter ends in NaN, and as plain values."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass

import torch

from diffprt.errors import InputError

# Tensors of more numbers, such as tables of measured BRDFs, are recorded by their shape and hash.
_MOST_NUMBERS = 64

Parameter = float | tuple[float, float, float] | torch.Tensor


def checked(what: str, value: Parameter, low: float, high: float, remedy: str, *, colors: bool = False) -> torch.Tensor:
    """`value` as a tensor: [] or, where `colors` are allowed, [3]. Gradients pass.

    Raises:
        InputError: another shape, or a value outside [low, high] (a NaN is).
    """
    tensor = value if isinstance(value, torch.Tensor) else torch.tensor(value, dtype=torch.float64)
    if not tensor.is_floating_point():
        tensor = tensor.double()
    if tensor.shape not in ((), (3,)) or (tensor.dim() and not colors):
        wanted = "one number or three" if colors else "one number"
        raise InputError(f"{what} has shape {list(tensor.shape)}: give {wanted}")
    detached = tensor.detach()
    if not bool(((detached >= low) & (detached <= high)).all()):
        raise InputError(f"{what} is {detached.tolist()}: {remedy}")
    return tensor


def of_dtype(parameter: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """`parameter` in the dtype and on the device of `like`."""
    return parameter.to(device=like.device, dtype=like.dtype)


def described(owner: object) -> dict:
    """Fields of a dataclass as plain values; those of a dataclass among them stand in its place.

    Raises:
        InputError: a value, or an attribute that is no field, that a file cannot record.
    """
    if stray := vars(owner).keys() - {f.name for f in fields(owner)}:
        raise InputError(_unrecorded(owner, min(stray)))
    plain: dict[str, float | str | list[float]] = {}
    for f in (f for f in fields(owner) if f.init):
        value = getattr(owner, f.name)
        if is_dataclass(value):
            plain |= described(value)
        elif isinstance(value, torch.Tensor):
            plain[f.name] = value.detach().tolist() if value.numel() <= _MOST_NUMBERS else _hashed(value)
        elif isinstance(value, str | int | float):
            plain[f.name] = value
        else:
            raise InputError(_unrecorded(owner, f.name))
    return plain


def _hashed(values: torch.Tensor) -> str:
    digest = hashlib.sha256(values.detach().cpu().contiguous().numpy().tobytes()).hexdigest()
    return f"{str(values.dtype).removeprefix('torch.')} {list(values.shape)} sha256 {digest}"


def _unrecorded(owner: object, name: str) -> str:
    return (
        f"{type(owner).__name__} has '{name}', which assets cannot record: make it a field of a frozen dataclass that "
        "holds a number, a tensor, a word or such a dataclass"
    )
