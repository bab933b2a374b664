"""Lights by the names that studies take."""

from __future__ import annotations

from diffprt.scene import BUILTIN_ENVIRONMENTS, Light, load_environment


def named_light(name: str, order: int, **options: str) -> Light:
    """A built-in environment or a map, projected; `options` are those of `Environment.project`."""
    return load_environment(f"builtin:{name}" if name in BUILTIN_ENVIRONMENTS else name).project(order, **options)
