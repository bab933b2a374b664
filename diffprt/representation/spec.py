"""What tensors a representation or its elements consist of: what files, checks, `info` and training follow from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

FLOATS = ("float32", "float64")


@dataclass(frozen=True)
class TensorSpec:
    """One tensor.

    Attributes:
        axes: a letter or word for each dimension, the same one wherever the length is the same, or a fixed length.
        dtypes: those it may have, as torch names them.
        per_element: its first axis counts elements, so that rows in sight can be picked.
        trainable: it is part of the signal, and gradients may reach it.
        optional: it may be missing.
    """

    axes: tuple[str | int, ...]
    dtypes: tuple[str, ...] = FLOATS
    per_element: bool = False
    trainable: bool = False
    optional: bool = False


Spec = Mapping[str, TensorSpec]


def mismatch(spec: Spec, shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """What is wrong with tensors of these shapes, in words; None where they follow the spec."""
    wanted = {name for name, tensor in spec.items() if not tensor.optional}
    if not wanted <= set(shapes) <= set(spec):
        return f"holds {sorted(shapes)}, wanted {sorted(wanted)}"
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
    return None


def _text(axes: tuple[str | int, ...]) -> str:
    return f"[{', '.join(map(str, axes))}]"
