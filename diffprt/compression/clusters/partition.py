"""A partition of receivers into clusters: names, members, their sums and means."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.sparse import csr_matrix

_ROWS = 4096


@dataclass(frozen=True)
class Partition:
    """Labels and what it took to find them.

    Attributes:
        labels: int64 [V], in [0, M); no cluster is empty.
        centers: float [M, D], means of the members.
        energy: sum of squared distances to the centers.
        iterations: rounds until the relative gain fell below the tolerance.
    """

    labels: torch.Tensor
    centers: torch.Tensor
    energy: float
    iterations: int


@dataclass(frozen=True)
class Clustering:
    """What a method found.

    Attributes:
        labels: int64 [V]; of `cluster` in [0, M) without empty clusters, of a method itself any.
        iterations: rounds of clustering.
        coherence: the weight of coherence that was used, None where the method has none.
        timings: seconds of each step.
    """

    labels: torch.Tensor
    iterations: int
    coherence: float | None = None
    timings: dict[str, float] = field(default_factory=dict)


def canonical(labels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Names clusters in the order in which receivers first meet them; empty clusters vanish.

    Args:
        labels: int64 [V].

    Returns:
        labels int64 [V] in [0, M), and the old name int64 [M] of every new one.
    """
    used, inverse = labels.unique(return_inverse=True)
    first = torch.full((len(used),), len(labels), dtype=torch.int64)
    first.scatter_reduce_(0, inverse, torch.arange(len(labels)), "amin")
    order = first.argsort()
    rank = torch.empty_like(order)
    rank[order] = torch.arange(len(order))
    return rank[inverse], used[order]


def members(labels: torch.Tensor, clusters: int) -> tuple[torch.Tensor, ...]:
    """The rows of each of `clusters` clusters, int64, ascending; of labels int64 [V]."""
    return labels.argsort(stable=True).split(torch.bincount(labels, minlength=clusters).tolist())


def member_sums(values: torch.Tensor, labels: torch.Tensor, clusters: int) -> torch.Tensor:
    """Sums [M, D] of the rows of `values` [V, D] over the members of each cluster."""
    # One sparse product: index_add_ would write rows one after another in no order that caches like.
    rows = csr_matrix(
        (np.ones(len(labels), dtype=values.numpy().dtype), (labels.numpy(), np.arange(len(labels)))),
        shape=(clusters, len(labels)),
    )
    return torch.from_numpy(rows @ values.numpy())


def member_means(vectors: torch.Tensor, labels: torch.Tensor, clusters: int) -> torch.Tensor:
    """Means [M, D] of the members of each cluster; zero where there are none."""
    counts = torch.bincount(labels, minlength=clusters).clamp_min(1)
    return member_sums(vectors, labels, clusters) / counts[:, None]


def nearest(vectors: torch.Tensor, centers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Index [V] of the nearest center (ties to the lowest) and the squared distance [V] to it.

    One product per block of rows instead of a difference per pair; the distance to the winner alone is then
    found from the difference, which does not cancel.
    """
    norms, columns = centers.square().sum(1), centers.T.contiguous()
    labels = torch.empty(len(vectors), dtype=torch.int64)
    squared = vectors.new_empty(len(vectors))
    for first in range(0, len(vectors), _ROWS):
        rows = vectors[first : first + _ROWS]
        own = torch.addmm(norms, rows, columns, alpha=-2).argmin(1)
        labels[first : first + _ROWS] = own
        squared[first : first + _ROWS] = (rows - centers[own]).square().sum(1)
    return labels, squared
