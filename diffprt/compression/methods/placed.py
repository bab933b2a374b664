"""Signals with their places: where clusters around subspaces start.

The signal of a small patch of surface varies in few directions, whichever signal that is. Means alone do not see
that: they gather receivers of like signal from all over the mesh, which vary in many.
"""

from __future__ import annotations

import torch

from diffprt.compression.methods.geometry_coherence import unit_box

_SHARE = 1.0


def placed(vectors: torch.Tensor, positions: torch.Tensor, *, share: float = _SHARE) -> torch.Tensor:
    """Signals [V, D] and positions [V, 3] side by side, [V, D + 3], for k-means of both.

    Args:
        vectors: float [V, D].
        positions: float [V, 3], in any unit.
        share: variance of the positions, scaled alike in all axes, over that of the signals.
    """
    points = unit_box(positions)
    points = points - points.mean(0)
    extent = float(points.square().sum(1).mean())
    spread = float((vectors - vectors.mean(0)).square().sum(1, dtype=torch.float64).mean())
    scale = (share * spread / extent) ** 0.5 if extent > 0 else 0.0
    return torch.cat([vectors, (scale * points).to(vectors.dtype)], 1)
