"""Directions: one golden-angle spiral for all receivers, turned by each receiver's own angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class Pattern:
    """What `kernels.direct` needs to make a receiver's directions.

    Attributes:
        spiral: float32 [D, 2], cosine and sine of D golden angles (Vogel 1979).
        rotation: float32 [V, 2], cosine and sine of each receiver's turn.
        ring_shift: float32 [V], in [0, 1).
    """

    spiral: torch.Tensor
    rotation: torch.Tensor
    ring_shift: torch.Tensor

    @staticmethod
    def create(rays: int, scramble: torch.Tensor) -> Pattern:
        """The pattern of `rays` directions for receivers with the numbers `scramble` int64 [V]."""
        angle = torch.arange(rays, dtype=torch.float64) * _GOLDEN_ANGLE
        turn = (scramble & 0xFFFF).double() / 65536 * (2 * math.pi)
        shift = ((scramble >> 16).double() + 0.5) / 65536
        return Pattern(
            torch.stack([angle.cos(), angle.sin()], dim=1).float(),
            torch.stack([turn.cos(), turn.sin()], dim=1).float(),
            shift.float(),
        )


def tangent_frames(normals: torch.Tensor) -> torch.Tensor:
    """Branchless orthonormal bases (Duff et al. 2017): [V, 3, 3], columns tangent, bitangent, normal."""
    x, y, z = normals.unbind(-1)
    s = torch.where(z >= 0, 1.0, -1.0).to(normals.dtype)
    a = -1.0 / (s + z)
    b = x * y * a
    tangent = torch.stack([1.0 + s * x * x * a, s * b, -s * x], dim=-1)
    bitangent = torch.stack([b, s + y * y * a, -y], dim=-1)
    return torch.stack([tangent, bitangent, normals], dim=-1)


def hemisphere_directions(normals: torch.Tensor, pattern: Pattern) -> torch.Tensor:
    """All directions [V, D, 3], cosine-distributed about `normals` [V, 3]: the twin of the kernel's sampling."""
    dtype = normals.dtype
    spiral, rotation, shift = (t.to(dtype) for t in (pattern.spiral, pattern.rotation, pattern.ring_shift))
    rays = len(spiral)
    square = (torch.arange(rays, dtype=dtype) + shift[:, None]) / rays
    cosine = spiral[:, 0] * rotation[:, :1] - spiral[:, 1] * rotation[:, 1:]
    sine = spiral[:, 0] * rotation[:, 1:] + spiral[:, 1] * rotation[:, :1]
    radius = square.sqrt()
    local = torch.stack([radius * cosine, radius * sine, (1.0 - square).clamp_min(0).sqrt()], dim=-1)
    return torch.einsum("vij,vdj->vdi", tangent_frames(normals), local)
