"""Where clustering starts."""

from __future__ import annotations

import torch

STARTS = ("k-means++", "hyper-box")
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
