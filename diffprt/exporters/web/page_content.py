"""A page before it is written."""

from __future__ import annotations

from dataclasses import dataclass

from diffprt.scene.camera import Camera


@dataclass(frozen=True)
class Page:
    """A page, the camera it opens with, and what `export` reports of it."""

    content: bytes
    camera: Camera
    parts: dict[str, int]
    counts: dict[str, int]
    programs: tuple[str, ...]
    left_out: tuple[str, ...]
