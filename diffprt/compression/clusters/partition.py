"""A partition of receivers into clusters: names, members, their sums and means."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.sparse import csr_matrix

from diffprt.errors import InputError

_ROWS = 4096


def whole_labels(labels: torch.Tensor, clusters: int | None = None) -> torch.Tensor:
    """Labels of any integer type as int64 [V], which is what tensors are indexed with: uint8 would be read as a mask.

    Args:
        labels: [V], uint8 to uint64 or int8 to int64.
        clusters: M; without it, labels may be any from 0 up.

    Raises:
        InputError: other numbers than whole ones, another shape, or a label that names no cluster.
    """
    labels = torch.as_tensor(labels)
    if labels.is_floating_point() or labels.is_complex() or labels.dtype == torch.bool:
        raise InputError(f"labels of dtype {labels.dtype}: give whole numbers, such as torch.int64")
    if labels.dim() != 1:
        raise InputError(f"labels of shape {tuple(labels.shape)}: give one for each receiver, (V,)")
    whole = labels.to(torch.int64)
    low, high = (int(whole.min()), int(whole.max())) if len(whole) else (0, 0)
    if low < 0 or (clusters is not None and high >= clusters):
        wanted = "numbers from 0 up" if clusters is None else f"one of {clusters} clusters; in a file, compress again"
        outside = "below 0" if clusters is None else f"outside 0..{clusters - 1}"
        raise InputError(f"labels {outside}, from {low} to {high}: give {wanted}")
    return whole


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
