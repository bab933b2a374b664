"""Axes about normals."""

from __future__ import annotations

import torch


def tangent_frames(normals: torch.Tensor) -> torch.Tensor:
    """Branchless orthonormal bases (Duff et al. 2017): [V, 3, 3], columns tangent, bitangent, normal."""
    x, y, z = normals.unbind(-1)
    s = torch.where(z >= 0, 1.0, -1.0).to(normals.dtype)
    a = -1.0 / (s + z)
    b = x * y * a
    tangent = torch.stack([1.0 + s * x * x * a, s * b, -s * x], dim=-1)
    bitangent = torch.stack([b, s + y * y * a, -y], dim=-1)
    return torch.stack([tangent, bitangent, normals], dim=-1)
