"""The few directions in which all signals together vary: coordinates that clustering can afford.

Distances between signals are kept to within what is left out, so clusters found in the span are clusters of the
signals; the final components are fitted to the signals themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

_START = 256
_POWER_PASSES = 1


@dataclass(frozen=True)
class Span:
    """Signals as mean + coordinates · axes + remainder.

    Attributes:
        coordinates: float [V, R], by falling variance.
        mean: float [D].
        axes: float [R, D], orthonormal rows.
        remainder: share of the variance left out, in [0, 1].
    """

    coordinates: torch.Tensor
    mean: torch.Tensor
    axes: torch.Tensor
    remainder: float


def principal_span(vectors: torch.Tensor, *, remainder: float = 1e-3, seed: int = 0) -> Span:
    """Coordinates in the leading principal directions, by randomized subspace iteration.

    Args:
        vectors: float [V, D].
        remainder: share of the variance that may be left out; directions are doubled until it is met.
        seed: of the random start.

    Source: Halko, Martinsson and Tropp 2011, algorithms 4.4 and 5.1.
    """
    mean = vectors.mean(0)
    centered = vectors - mean
    size, total = vectors.shape[1], float(centered.square().sum(1).double().sum())
    if total == 0.0 or size <= _START:
        return Span(centered, mean, torch.eye(size, dtype=vectors.dtype), 0.0)
    generator = torch.Generator().manual_seed(seed)
    rank = _START
    while True:
        if rank >= min(vectors.shape):
            return Span(centered, mean, torch.eye(size, dtype=vectors.dtype), 0.0)
        axes = torch.randn(size, rank, generator=generator, dtype=vectors.dtype)
        for _ in range(_POWER_PASSES):
            axes = torch.linalg.qr(centered.T @ (centered @ axes))[0]
        coordinates = centered @ axes
        variances, turn = torch.linalg.eigh(coordinates.T @ coordinates)
        left_out = max(0.0, 1.0 - float(variances.double().sum()) / total)
        if left_out <= remainder:
            kept = variances.flip(0).double().cumsum(0) <= (1.0 - remainder) * total
            keep = min(rank, int(kept.sum()) + 1)
            turn = turn.flip(1)[:, :keep]
            left_out = max(0.0, 1.0 - float(variances.flip(0)[:keep].double().sum()) / total)
            return Span(coordinates @ turn, mean, (axes @ turn).T.contiguous(), left_out)
        rank *= 2
