"""Tangent frames, and rotation into many of them at once.

`rotation_matrices` follows a recurrence for one rotation. Here the functions are evaluated at a few turned points
and fitted again, band by band: for fixed points x, y_l(F x)ᵀ = y_l(x)ᵀ D_l(F), so D_l(F) = Y_l(x)⁺ Y_l(F x).
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch

from diffprt.errors import InputError
from diffprt.sh.basis import PRODUCT_ORDER, basis, check_order


def tangent_frames(normals: torch.Tensor) -> torch.Tensor:
    """Branchless orthonormal bases of [..., 3] (Duff et al. 2017): [..., 3, 3], columns tangent, bitangent, normal."""
    x, y, z = normals.unbind(-1)
    s = torch.where(z >= 0, 1.0, -1.0).to(normals.dtype)
    a = -1.0 / (s + z)
    b = x * y * a
    tangent = torch.stack([1.0 + s * x * x * a, s * b, -s * x], dim=-1)
    bitangent = torch.stack([b, s + y * y * a, -y], dim=-1)
    return torch.stack([tangent, bitangent, normals], dim=-1)


def frame_rotations(frames: torch.Tensor, order: int) -> list[torch.Tensor]:
    """Blocks D_l that turn coefficients on outer axes into coefficients on each frame's axes.

    f(F x) = Σ (D c)_k y_k(x) where f(d) = Σ c_k y_k(d): D is `rotation_matrix` of Fᵀ.

    Args:
        frames: float [V, 3, 3], orthonormal; columns are the frame's axes.
        order: as in `basis`.
    Returns:
        `order` tensors [V, 2l+1, 2l+1] in the dtype of `frames`. Gradients reach the frames.
    Raises:
        InputError: frames not [V, 3, 3], order out of range.
    """
    if frames.dim() != 3 or tuple(frames.shape[1:]) != (3, 3) or not frames.is_floating_point():
        raise InputError(f"frames are {frames.dtype} {list(frames.shape)}: give floating-point [V, 3, 3]")
    points, fits = _points(check_order(order, most=PRODUCT_ORDER))
    turned = basis(torch.einsum("vij,sj->vsi", frames, points.to(frames)), order)
    return [fit.to(frames) @ turned[..., l * l : (l + 1) ** 2] for l, fit in enumerate(fits)]


def to_frames(coefficients: torch.Tensor, rotations: list[torch.Tensor]) -> torch.Tensor:
    """Coefficients [V, K] on each frame's axes from those on outer axes, D c."""
    parts = [(block @ coefficients[:, l * l : (l + 1) ** 2, None])[..., 0] for l, block in enumerate(rotations)]
    return torch.cat(parts, dim=-1)


def from_frames(coefficients: torch.Tensor, rotations: list[torch.Tensor]) -> torch.Tensor:
    """Coefficients [V, K] on outer axes from those on each frame's, Dᵀ c."""
    return to_frames(coefficients, [block.transpose(1, 2) for block in rotations])


def rows_from_frames(matrices: torch.Tensor, rotations: list[torch.Tensor]) -> torch.Tensor:
    """Matrices [V, R, K] that act on coefficients on outer axes, from those that act on the frame's: M D."""
    parts = [matrices[..., l * l : (l + 1) ** 2] @ block for l, block in enumerate(rotations)]
    return torch.cat(parts, dim=-1)


@lru_cache(maxsize=16)
def _points(order: int) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """Points [S, 3] on a spiral (Vogel 1979), twice as many as the last band needs, and Y_l(x)⁺ of each band."""
    count = 2 * (2 * order - 1)
    index = torch.arange(count, dtype=torch.float64)
    z, angle = 1 - (2 * index + 1) / count, index * (math.pi * (3 - math.sqrt(5)))
    radius = (1 - z * z).sqrt()
    points = torch.stack([radius * angle.cos(), radius * angle.sin(), z], dim=-1)
    values = basis(points, order)
    return points, [torch.linalg.pinv(values[:, l * l : (l + 1) ** 2]) for l in range(order)]
