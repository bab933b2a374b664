"""Ambient occlusion and bent normals, read off the first two bands of direct transfer."""

from __future__ import annotations

import torch

from diffprt import sh


def openness(direct: torch.Tensor) -> torch.Tensor:
    """Share of the sky that each receiver sees, weighted by the cosine (1 minus ambient occlusion).

    Band 0 of direct transfer is that share times an open receiver's: no ray beyond transfer's own is needed.

    Args:
        direct: [V, C, K], transfer without interreflection.

    Returns:
        float32 [V] in [0, 1]; no gradients.
    """
    whole = float(sh.clamped_cosine(1, torch.float64)[0])
    return (direct.detach()[:, 0, 0].double() / whole).clamp(0, 1).float()


def bent_normals(direct: torch.Tensor, normals: torch.Tensor) -> torch.Tensor | None:
    """Mean unblocked direction of each receiver, weighted by the cosine (Landis 2002).

    Band 1 of direct transfer is that mean, up to a factor: its basis functions are -y, z, -x.

    Args:
        direct: [V, C, K], transfer without interreflection.
        normals: [V, 3], taken where all is blocked.

    Returns:
        float32 [V, 3], unit; None at order 1, which has no band 1. No gradients.
    """
    if direct.shape[2] < 4:
        return None
    y, z, x = direct.detach()[:, 0, 1:4].double().unbind(1)
    mean = torch.stack([-x, -y, z], dim=1)
    length = mean.norm(dim=1, keepdim=True)
    # What is left of an open receiver's 1.02 when float32 sums of blocked rays cancel it.
    blocked = length < 1e-5
    return torch.where(blocked, normals.double(), mean / length.masked_fill(blocked, 1.0)).float()
