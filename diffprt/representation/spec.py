"""What tensors a representation or its elements consist of: what files, checks, `info` and training follow from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

FLOATS = ("float32", "float64")
# What rounding may add to a bound.
_SLACK = 1e-4
# Names that messages show, and how much of each.
_MOST, _LONGEST = 16, 40


@dataclass(frozen=True)
class TensorSpec:
    """One tensor. Numbers are finite.

    Attributes:
        axes: a letter or word for each dimension, the same one wherever the length is the same, or a fixed length.
        dtypes: those it may have, as torch names them.
        per_element: its first axis counts elements, so that rows in sight can be picked.
        trainable: it is part of the signal, and gradients may reach it.
        optional: it may be missing.
        least, most: what its numbers lie between.
        index_of: the axis whose entries its numbers name, from 0.
    """

    axes: tuple[str | int, ...]
    dtypes: tuple[str, ...] = FLOATS
    per_element: bool = False
    trainable: bool = False
    optional: bool = False
    least: float = -math.inf
    most: float = math.inf
    index_of: str | None = None


Spec = Mapping[str, TensorSpec]


def mismatch(spec: Spec, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, str]) -> str | None:
    """What is wrong with tensors of these shapes and dtypes, in words; None where they follow the spec."""
    wanted = {name for name, tensor in spec.items() if not tensor.optional}
    if not wanted <= set(shapes) <= set(spec):
        return f"holds {_names(shapes)}, wanted {_names(wanted)}"
    lengths: dict[str, tuple[int, str]] = {}
    for name, shape in shapes.items():
        axes = spec[name].axes
        if len(shape) != len(axes):
            return f"has {name} of shape {list(shape)}, wanted {_text(axes)}"
        for axis, length in zip(axes, shape, strict=True):
            known, first = (axis, name) if isinstance(axis, int) else lengths.setdefault(axis, (length, name))
            if length != known:
                beside = "" if first == name else f" beside {first} of {list(shapes[first])}"
                return f"has {name} of shape {list(shape)}, wanted {_text(axes)}{beside}"
        if dtypes[name] not in spec[name].dtypes:
            return f"has {name} of dtype {dtypes[name]}, wanted {' or '.join(spec[name].dtypes)}"
    return None


def wrong_values(spec: Spec, tensors: Mapping[str, torch.Tensor]) -> str | None:
    """What is wrong with the numbers of tensors whose shapes and dtypes follow the spec, in words; None where nothing
    is. Each is read once."""
    lengths = {a: n for name, t in tensors.items() for a, n in zip(spec[name].axes, t.shape, strict=True)}
    for name, tensor in tensors.items():
        wanted = spec[name]
        floating = tensor.is_floating_point()
        bounded = wanted.index_of is not None or math.isfinite(wanted.least) or math.isfinite(wanted.most)
        if tensor.numel() == 0 or not (floating or bounded):
            continue
        # The least and largest number are NaN where any is. Integers without an order of their own are widened.
        values = tensor if floating or tensor.itemsize in (1, 4, 8) else tensor.int()
        low, high = (float(value) for value in values.detach().aminmax())
        if not (math.isfinite(low) and math.isfinite(high)):
            return f"has non-finite {name}"
        if wanted.index_of is not None and not 0 <= low <= high < lengths[wanted.index_of]:
            return f"has {name} outside 0..{lengths[wanted.index_of] - 1}, from {low:.0f} to {high:.0f}"
        if not wanted.least - _SLACK <= low <= high <= wanted.most + _SLACK:
            return f"has {name} from {low:.6g} to {high:.6g}, wanted {wanted.least:g} to {wanted.most:g}"
    return None


def _names(names: Iterable[str]) -> str:
    """Names for messages, of which files may hold many, and long ones."""
    shown = [name[:_LONGEST] for name in sorted(names)]
    return f"{shown[:_MOST]}" + (f" and {len(shown) - _MOST} more" if len(shown) > _MOST else "")


def _text(axes: tuple[str | int, ...]) -> str:
    return f"[{', '.join(map(str, axes))}]"
