"""Checks of what describes a BRDF, so that no parameter ends in NaN."""

from __future__ import annotations

import torch

from diffprt.errors import InputError

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
