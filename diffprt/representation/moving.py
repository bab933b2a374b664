"""Moving what consists of tensors to another device or dtype."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TypeVar

import torch

T = TypeVar("T")


def device_of(target: torch.device | torch.dtype | str, values: torch.Tensor) -> torch.device | str:
    """Where `values` go: their own device, where `target` is a dtype."""
    return values.device if isinstance(target, torch.dtype) else target


def moved(holder: T, target: torch.device | torch.dtype | str, fixed: frozenset[str] = frozenset()) -> T:
    """A dataclass with its tensors on another device, or its floating tensors in another dtype.

    Args:
        target: a device or its name, or a floating dtype.
        fixed: tensors whose dtype stays as it is.
    """
    found = {}
    for entry in fields(holder):  # type: ignore[arg-type]
        value = getattr(holder, entry.name)
        keeps = isinstance(target, torch.dtype) and entry.name in fixed
        if isinstance(value, torch.Tensor) and not keeps:
            found[entry.name] = value.to(target) if value.is_floating_point() else value.to(device_of(target, value))
    return replace(holder, **found)  # type: ignore[type-var]
