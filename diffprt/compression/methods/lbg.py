"""Vector quantization by the algorithm of Linde, Buzo and Gray (1980), as the 2005 thesis describes it."""

from __future__ import annotations

import torch

from diffprt.compression.clusters.partition import Clustering, Partition, canonical, member_means, nearest
from diffprt.compression.methods.starts import hyper_box, plus_plus
from diffprt.errors import InputError
from diffprt.options.compress import STARTS, ClusterOptions


def lbg(
    vectors: torch.Tensor,
    clusters: int,
    *,
    start: str = "k-means++",
    seed: int = 0,
    iterations: int = 50,
    tolerance: float = 1e-4,
) -> Partition:
    """Partitions vectors around their means (thesis 2005, figure 3.2, equations 4 and 5).

    Args:
        vectors: float [V, D].
        clusters: at most this many; clusters beyond the number of distinct vectors are dropped.
        start: "k-means++", or the thesis's "hyper-box".
        seed: of the start.
        iterations: at most this many rounds.
        tolerance: stop when the energy falls by less than this share of itself, or is zero.

    Raises:
        InputError: `start` is unknown.
    """
    centers = start_centers(vectors, clusters, start, seed)
    before, done = float("inf"), 0
    for _ in range(iterations):
        done += 1
        labels, squared = nearest(vectors, centers)
        energy = float(squared.sum(dtype=torch.float64))
        labels = fill_empty(vectors, labels, len(centers))
        centers = member_means(vectors, labels, len(centers))
        if energy == 0.0 or before - energy <= tolerance * before < float("inf"):
            break
        before = energy
    labels, squared = nearest(vectors, centers)
    labels, names = canonical(labels)
    return Partition(labels, centers[names], float(squared.sum(dtype=torch.float64)), done)


def by_means(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "lbg"."""
    found = lbg(vectors, options.clusters, **options.lbg)
    return Clustering(found.labels, found.iterations)


def start_centers(vectors: torch.Tensor, clusters: int, start: str, seed: int) -> torch.Tensor:
    """The first centers [M, D]; raises InputError where `start` is unknown."""
    if start not in STARTS:
        raise InputError(f"start '{start}' is unknown: use one of {', '.join(STARTS)}")
    generator = torch.Generator().manual_seed(seed)
    return (plus_plus if start == "k-means++" else hyper_box)(vectors, clusters, generator)


def fill_empty(vectors: torch.Tensor, labels: torch.Tensor, clusters: int) -> torch.Tensor:
    """Null cluster avoidance: while a cluster is empty, the fullest one is divided (thesis 2005, section 3.1.2).

    It is cut through its mean, across the direction to its farthest member, so the energy falls. Clusters of
    identical vectors cannot be divided; what then stays empty is dropped by the caller.
    """
    counts = torch.bincount(labels, minlength=clusters)
    empty = (counts == 0).nonzero().flatten().tolist()
    if not empty:
        return labels
    labels = labels.clone()
    divisible = counts.clone()
    for target in empty:
        while int(divisible.max()) > 1:
            full = int(divisible.argmax())
            members = (labels == full).nonzero().flatten()
            away = vectors[members] - vectors[members].mean(0)
            farthest = away[int(away.square().sum(1).argmax())]
            beyond = members[away @ farthest > 0]
            if 0 < len(beyond) < len(members):
                labels[beyond] = target
                divisible[target], divisible[full] = len(beyond), len(members) - len(beyond)
                break
            divisible[full] = 0
        else:
            break
    return labels
