"""Clusters around affine subspaces instead of means: what CPCA stores is what decides who belongs where."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.compression.clusters.near import NearErrors, near_clusters
from diffprt.compression.clusters.partition import Clustering, whole_labels
from diffprt.compression.clusters.subspaces import Subspaces, fit_subspaces
from diffprt.compression.methods.lbg import lbg
from diffprt.compression.methods.starts import placed
from diffprt.options.compress import ClusterOptions

# Rounds that suffice before labels are given a price.
FEW_ROUNDS = 8


@dataclass(frozen=True)
class SubspacePartition:
    """Labels, the subspaces that they were chosen for, and what it took.

    Attributes:
        labels: int64 [V], in [0, M); clusters may be empty.
        subspaces: of the M clusters.
        error: mean squared distance of the vectors to their subspaces.
        iterations: rounds.
    """

    labels: torch.Tensor
    subspaces: Subspaces
    error: float
    iterations: int


def k_subspaces(
    vectors: torch.Tensor,
    labels: torch.Tensor,
    components: int,
    *,
    iterations: int = 30,
    tolerance: float = 1e-3,
) -> SubspacePartition:
    """Alternates fitting a subspace to each cluster and giving each vector to the subspace that is nearest.

    Both halves lower the same squared error, that of CPCA itself; LBG lowers the distance to means, which the
    components then make up for.

    Args:
        vectors: float [V, D].
        labels: [V], whole numbers of any type, where to start, such as those of `lbg`.
        components: P.
        iterations: at most this many rounds.
        tolerance: stop when the error falls by less than this share of itself.

    Source: Bradley and Mangasarian 2000 (k-plane clustering); Kambhatla and Leen 1997 for components.
    """
    labels = whole_labels(labels)
    clusters = int(labels.max()) + 1
    before, done, bases = float("inf"), 0, None
    for _ in range(iterations):
        done += 1
        subspaces = fit_subspaces(vectors, labels, clusters, components, bases=bases)
        bases = subspaces.bases
        near = near_clusters(subspaces, vectors, labels)
        labels, errors = NearErrors.of(subspaces, vectors, labels, near).nearest()
        error = float(errors.double().mean())
        if before - error <= tolerance * before < float("inf") or error == 0.0:
            break
        before = error
    return SubspacePartition(labels, subspaces, error, done)


def by_subspaces(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "k-subspaces"."""
    starts, rounds = subspace_starts(vectors, options)
    tried = [k_subspaces(vectors, start, options.components, iterations=options.iterations) for start in starts]
    best = min(tried, key=lambda partition: partition.error)
    return Clustering(best.labels, rounds + best.iterations)


def subspace_starts(vectors: torch.Tensor, options: ClusterOptions) -> tuple[list[torch.Tensor], int]:
    """Labels int64 [V] to start from, those of `lbg` last, and the rounds that these took."""
    found = lbg(vectors, options.clusters, **options.lbg)
    starts = [found.labels]
    if options.positions is not None:
        rows = placed(vectors, options.positions)
        starts.insert(0, lbg(rows, len(found.centers), **options.lbg).labels)
    return starts, found.iterations
