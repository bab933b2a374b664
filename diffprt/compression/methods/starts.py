"""Where clustering starts."""

from __future__ import annotations

import torch

_ROWS = 4096


def plus_plus(vectors: torch.Tensor, clusters: int, generator: torch.Generator) -> torch.Tensor:
    """Vectors [M, D], drawn with probability proportional to their squared distance to those before.

    Draws are made in rounds, each a quarter as many as are there already, so that distances are matrix products.
    Fewer than `clusters` when there are no more distinct vectors.

    Source: Arthur and Vassilvitskii 2007; rounds after Bahmani et al. 2012.
    """
    norms = vectors.square().sum(1)
    chosen = torch.randint(len(vectors), (1,), generator=generator)
    squared = (vectors - vectors[chosen]).square().sum(1)
    while len(chosen) < clusters and float(squared.max()) > 0:
        cumulative = squared.double().cumsum(0)
        count = min(clusters - len(chosen), len(chosen) // 4 + 1)
        draws = torch.rand(count, generator=generator, dtype=torch.float64) * cumulative[-1]
        picks = torch.searchsorted(cumulative, draws, right=True).clamp_max(len(vectors) - 1).unique()
        chosen = torch.cat([chosen, picks])
        for first in range(0, len(vectors), _ROWS):
            rows = slice(first, first + _ROWS)
            offset, pick = torch.addmm(norms[picks], vectors[rows], vectors[picks].T, alpha=-2).min(1)
            fresh = offset + norms[rows]
            # a chosen vector and its copies are at exactly zero, which the product form does not give
            close = (fresh <= 1e-4 * norms[rows]).nonzero().flatten()
            fresh[close] = (vectors[rows][close] - vectors[picks[pick[close]]]).square().sum(1)
            squared[rows] = torch.minimum(squared[rows], fresh)
    return vectors[chosen].clone()


def hyper_box(vectors: torch.Tensor, clusters: int, generator: torch.Generator) -> torch.Tensor:
    """Points [M, D], uniform in the box that bounds the vectors (thesis 2005, section 3.1.2)."""
    low, high = vectors.amin(0), vectors.amax(0)
    spread = torch.rand(clusters, vectors.shape[1], generator=generator, dtype=torch.float64).to(vectors.dtype)
    return low + spread * (high - low)


def unit_box(positions: torch.Tensor) -> torch.Tensor:
    """Positions [V, 3] moved and scaled alike in all axes into the unit box, float64: equation 9 depends on units."""
    low = positions.double().amin(0)
    extent = float((positions.double().amax(0) - low).max())
    return (positions.double() - low) / (extent or 1.0)


def placed(vectors: torch.Tensor, positions: torch.Tensor, *, share: float = 1.0) -> torch.Tensor:
    """Signals [V, D] and positions [V, 3] side by side, [V, D + 3], for k-means of both.

    The signal of a small patch of surface varies in few directions, whichever signal that is. Means alone do not see
    that: they gather receivers of like signal from all over the mesh, which vary in many.

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
