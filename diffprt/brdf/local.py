"""Geometry in the local frame (z is the normal)."""

from __future__ import annotations

import math

import torch

from diffprt.sh.frames import tangent_frames


def mirrored(directions: torch.Tensor) -> torch.Tensor:
    """Directions [..., 3] reflected about the normal: (-x, -y, z)."""
    return directions * directions.new_tensor([-1.0, -1.0, 1.0])


def half_vector(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Unit bisector [..., 3] of a and b, on the side of the normal; the normal where they are opposite."""
    total = a + b
    square = (total * total).sum(-1, keepdim=True)
    opposite = square < 1e-30
    normal = total.new_tensor([0.0, 0.0, 1.0])
    h = torch.where(opposite, normal, total / torch.where(opposite, 1.0, square).sqrt())
    return torch.where(h[..., 2:] < 0, -h, h)


def about(axis: torch.Tensor, cosine: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Unit directions [..., 3] at the polar angle with `cosine` [...] and azimuth `angle` [...] about unit `axis`."""
    tangent, bitangent, _ = tangent_frames(axis).unbind(-1)
    sine = ((1 - cosine) * (1 + cosine)).clamp_min(0).sqrt()
    parts = (sine * angle.cos())[..., None] * tangent + (sine * angle.sin())[..., None] * bitangent
    return parts + cosine[..., None] * axis


def cosine_sample(u: torch.Tensor) -> torch.Tensor:
    """Cosine-distributed directions [..., 3] of the upper hemisphere from `u` [..., 2] in [0, 1)."""
    radius, angle = u[..., 0].sqrt(), 2 * math.pi * u[..., 1]
    return torch.stack([radius * angle.cos(), radius * angle.sin(), (1 - u[..., 0]).clamp_min(0).sqrt()], dim=-1)


def cosine_pdf(directions: torch.Tensor) -> torch.Tensor:
    """Density [1/sr] of `cosine_sample` at directions [..., 3]."""
    return directions[..., 2].clamp_min(0) / math.pi
