"""The plain-torch twin of the rasterizer: every pixel tests every triangle. Slow; used by tests."""

from __future__ import annotations

import torch


def rasterize_reference(
    clip: torch.Tensor, faces: torch.Tensor, width: int, height: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Face, perspective-correct barycentrics and depth at every pixel center, as `kernels.raster.rasterize`.

    Args:
        clip: float [V, 4], clip-space positions (OpenGL).
        faces: int64 [F, 3].

    Gradients reach `clip` through barycentrics and depth; which face wins is frozen.
    """
    rows = 1 - (torch.arange(height, dtype=clip.dtype) + 0.5) / height * 2
    columns = (torch.arange(width, dtype=clip.dtype) + 0.5) / width * 2 - 1
    y, x = torch.meshgrid(rows, columns, indexing="ij")
    pixels = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(-1, 3)
    corners = clip[faces]
    columns_of_corners = corners[:, :, [0, 1, 3]].transpose(1, 2)
    flat = torch.linalg.det(columns_of_corners.detach()) == 0
    inverse = torch.linalg.inv(torch.where(flat[:, None, None], torch.eye(3, dtype=clip.dtype), columns_of_corners))
    e = torch.einsum("fij,pj->pfi", inverse, pixels)
    z = (e * corners[:, :, 2]).sum(-1)
    seen = (e >= 0).all(-1) & (e.sum(-1) > 0) & (z.abs() <= 1) & ~flat
    depth, face = torch.where(seen, z, torch.inf).min(dim=1)
    mask = torch.isfinite(depth)
    own = e[torch.arange(len(pixels)), face]
    w = 1.0 / torch.where(mask, own.sum(-1), 1.0)
    shape = (height, width)
    return (
        face.masked_fill(~mask, -1).reshape(shape),
        torch.where(mask[:, None], own * w[:, None], 0.0).reshape(*shape, 3),
        torch.where(mask, w, torch.inf).reshape(shape),
    )
