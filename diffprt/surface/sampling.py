"""Directions: one golden-angle spiral for all receivers, turned by each receiver's own angle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch

from diffprt.sh.frames import tangent_frames

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class Pattern:
    """What `diffprt.kernels` needs to make a receiver's directions.

    Attributes:
        spiral: float32 [D, 3], cosine and sine of a golden angle, and which multiple it is (Vogel 1979). Near
            directions stand together, down to pairs, so that runs of 16 are narrow packets and the even and the
            odd rows are two equally stratified halves.
        rotation: float32 [V, 2], cosine and sine of each receiver's turn.
        ring_shift: float32 [V], in [0, 1).
    """

    spiral: torch.Tensor
    rotation: torch.Tensor
    ring_shift: torch.Tensor

    @staticmethod
    def create(rays: int, scramble: torch.Tensor) -> Pattern:
        """The pattern of `rays` directions for receivers with the numbers `scramble` int64 [V]."""
        turn = (scramble & 0xFFFF).double() / 65536 * (2 * math.pi)
        shift = ((scramble >> 16).double() + 0.5) / 65536
        return Pattern(
            _spiral(rays),
            torch.stack([turn.cos(), turn.sin()], dim=1).float(),
            shift.float(),
        )


@lru_cache(maxsize=8)
def _spiral(rays: int) -> torch.Tensor:
    """The spiral's table, ordered by halving the hemisphere across its longest axis until two points are left.

    Across the principal axis of the directions, not of the disc under them: near the horizon a small step on the disc
    is a wide angle, and narrow packets meet fewer boxes.
    """
    index = np.arange(rays)
    angle = index * _GOLDEN_ANGLE
    square = (index + 0.5) / rays
    radius = np.sqrt(square)
    size = 1 << max(rays - 1, 1).bit_length()
    # Places beyond the last direction stay at the end: they hold no number, and such sort last.
    order = np.arange(size)
    points = np.full((size, 3), np.nan)
    points[:rays] = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - square)], axis=1)
    while size > 2:
        groups = points[order].reshape(-1, size, 3)
        held = np.isfinite(groups)
        centered = np.where(held, groups, 0.0)
        centered = np.where(held, groups - centered.sum(1, keepdims=True) / held.sum(1, keepdims=True).clip(1), 0.0)
        axes = np.linalg.eigh(centered.transpose(0, 2, 1) @ centered)[1][:, :, 2]
        along = np.where(held[:, :, 0], np.einsum("gsk,gk->gs", centered, axes), np.nan)
        ranks = np.argsort(along, axis=1, kind="stable")
        order = np.take_along_axis(order.reshape(-1, size), ranks, axis=1).reshape(-1)
        size //= 2
    table = np.stack([np.cos(angle), np.sin(angle), index], axis=1)
    return torch.from_numpy(table[order[order < rays]]).float()


def hemisphere_directions(normals: torch.Tensor, pattern: Pattern) -> torch.Tensor:
    """All directions [V, D, 3], cosine-distributed about `normals` [V, 3]: the twin of the kernel's sampling."""
    dtype = normals.dtype
    spiral, rotation, shift = (t.to(dtype) for t in (pattern.spiral, pattern.rotation, pattern.ring_shift))
    rays = len(spiral)
    square = (spiral[:, 2] + shift[:, None]) / rays
    cosine = spiral[:, 0] * rotation[:, :1] - spiral[:, 1] * rotation[:, 1:]
    sine = spiral[:, 0] * rotation[:, 1:] + spiral[:, 1] * rotation[:, :1]
    radius = square.sqrt()
    local = torch.stack([radius * cosine, radius * sine, (1.0 - square).clamp_min(0).sqrt()], dim=-1)
    return torch.einsum("vij,vdj->vdi", tangent_frames(normals), local)
