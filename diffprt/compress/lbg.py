"""Vector quantization by the algorithm of Linde, Buzo and Gray (1980), from a k-means++ start."""

from __future__ import annotations

from dataclasses import dataclass

import torch

_ROWS = 1 << 14


@dataclass(frozen=True)
class Partition:
    """Labels and what it took to find them.

    Attributes:
        labels: int64 [V], in [0, M).
        centers: float32 [M, D], means of the members.
        energy: sum of squared distances to the centers.
        iterations: rounds until the relative gain fell below the tolerance.
    """

    labels: torch.Tensor
    centers: torch.Tensor
    energy: float
    iterations: int


def lbg(
    vectors: torch.Tensor, clusters: int, *, seed: int = 0, iterations: int = 50, tolerance: float = 1e-4
) -> Partition:
    """Partitions vectors around their means.

    Args:
        vectors: float32 [V, D].
        clusters: at most this many; clusters beyond the number of distinct vectors are dropped.
        seed: of the k-means++ start (Arthur and Vassilvitskii 2007).
        iterations: at most this many rounds.
        tolerance: stop when the energy falls by less than this share of itself.
    """
    generator = torch.Generator().manual_seed(seed)
    centers = _plus_plus(vectors, clusters, generator)
    energy, done = float("inf"), 0
    for _ in range(iterations):
        done += 1
        labels, squared = nearest(vectors, centers)
        centers, labels = _update(vectors, labels, squared, len(centers))
        now = float(squared.double().sum())
        if energy - now <= tolerance * now:
            break
        energy = now
    labels, squared = nearest(vectors, centers)
    used, labels = labels.unique(return_inverse=True)
    return Partition(labels, centers[used], float(squared.double().sum()), done)


def nearest(vectors: torch.Tensor, centers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Index [V] of the nearest center (ties to the lowest) and the squared distance [V] to it."""
    norms = centers.square().sum(1)
    labels = torch.cat([(norms - 2 * (rows @ centers.T)).argmin(1) for rows in vectors.split(_ROWS)])
    squared = torch.cat(
        [(r - centers[l]).square().sum(1) for r, l in zip(vectors.split(_ROWS), labels.split(_ROWS), strict=True)]
    )
    return labels, squared


def _plus_plus(vectors: torch.Tensor, clusters: int, generator: torch.Generator) -> torch.Tensor:
    """Starting centers, each drawn with probability proportional to its squared distance to those before."""
    first = int(torch.randint(len(vectors), (1,), generator=generator))
    chosen = [first]
    squared = (vectors - vectors[first]).square().sum(1).double()
    while len(chosen) < clusters and float(squared.max()) > 0:
        cumulative = squared.cumsum(0)
        draw = torch.rand(1, generator=generator, dtype=torch.float64) * cumulative[-1]
        pick = min(int(torch.searchsorted(cumulative, draw, right=True)), len(vectors) - 1)
        chosen.append(pick)
        squared = torch.minimum(squared, (vectors - vectors[pick]).square().sum(1).double())
    return vectors[chosen].clone()


def _update(
    vectors: torch.Tensor, labels: torch.Tensor, squared: torch.Tensor, clusters: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Means of the members; an empty cluster takes the vector that is worst served."""
    counts = torch.bincount(labels, minlength=clusters)
    empty = (counts == 0).nonzero().flatten().tolist()
    if empty:
        labels = labels.clone()
        worst = squared.argsort(descending=True, stable=True)[: len(empty)]
        for cluster, vector in zip(empty, worst.tolist(), strict=True):
            labels[vector] = cluster
        counts = torch.bincount(labels, minlength=clusters)
    sums = torch.zeros(clusters, vectors.shape[1], dtype=torch.float64).index_add_(0, labels, vectors.double())
    return (sums / counts.clamp_min(1)[:, None]).to(vectors.dtype), labels
