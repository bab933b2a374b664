"""Less overdraw at no more error: subspace clustering with a price on every triangle that is drawn again."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.compression.clusters.near import NearErrors, near_clusters
from diffprt.compression.clusters.partition import Clustering
from diffprt.compression.clusters.subspaces import Subspaces, fit_subspaces
from diffprt.compression.methods.k_subspaces import FEW_ROUNDS, k_subspaces, subspace_starts
from diffprt.compression.methods.label_descent import sweep, sweep_patches
from diffprt.compression.methods.lbg import fill_empty
from diffprt.compression.overdraw.corners import Corners
from diffprt.compression.overdraw.overdraw import draws, overdraw
from diffprt.compression.overdraw.super_clusters import super_clusters
from diffprt.options.compress import ClusterOptions

_PRICES = [0.2 * 1.7**stage for stage in range(15)]
_ROUNDS = 3
_BELOW_LBG = 0.95
_HOPELESS, _RISING = 2.0, 1.01


@dataclass(frozen=True)
class PricedPartition:
    """Labels found with a price on overdraw.

    Attributes:
        labels: int64 [V], in [0, M); clusters may be empty.
        error: mean squared distance of the vectors to their subspaces.
        price: of one extra drawn triangle, in mean squared errors of the start.
        stages: (price, error, overdraw) on the way.
    """

    labels: torch.Tensor
    error: float
    price: float
    stages: list[tuple[float, float, float]]


def price_overdraw(
    vectors: torch.Tensor,
    labels: torch.Tensor,
    faces: torch.Tensor,
    subspaces: Subspaces,
    *,
    price: float | None = None,
    limit: float = float("inf"),
    slack: float = 0.1,
    per_pass: int | None = None,
    edges: bool = False,
) -> PricedPartition:
    """Lowers squared error + price x overdraw by labels, patches and subspaces in turn, at a rising price.

    The rising price is what makes it good: every stage starts from labels that were best at a lower one, and
    on the way the error falls too, since coherent labels escape minima that labels on their own do not.

    Args:
        vectors: float [V, D].
        labels: int64 [V], where to start, such as those of `k_subspaces`.
        faces: int64 [F, 3].
        subspaces: of the clusters.
        price: of one extra drawn triangle, in mean squared errors of the start. Without, the highest at which the
            error stays within `limit` and within 1 + `slack` of the least error on the way.
        limit: highest mean squared error.
        per_pass: clusters that share a pass (`clusters_per_pass`); the triangles that are then still drawn again are
            priced as well, and clusters are regrouped as they change. Without, clusters alone are priced.
        edges: price edges between labels (Potts 1952) in place of equation 8 itself.
    """
    units, clusters, components = len(vectors), *subspaces.bases.shape[:2]
    simplices = _edges(faces) if edges else faces
    corners = Corners.of(simplices, units)
    alone, groups = torch.arange(clusters), None

    def fit(labels: torch.Tensor) -> Subspaces:
        return fit_subspaces(vectors, labels, clusters, components, bases=subspaces.bases)

    unit = float(subspaces.own(vectors, labels).double().mean())
    best = PricedPartition(labels, unit, 0.0, [])
    least, stages = unit, []
    for now in _PRICES if price is None else [p for p in _PRICES if p < price] + [price]:
        if int(torch.bincount(labels, minlength=clusters).min()) == 0:
            labels = fill_empty(vectors, labels, clusters)
            subspaces = fit(labels)
        if per_pass is not None:
            groups = _regroup(labels, faces, per_pass, clusters, groups)
        prices = [(now * unit, alone)] if groups is None else [(now * unit / 2, alone), (now * unit, groups)]
        near = near_clusters(subspaces, vectors, labels, corners)
        moving = None  # later rounds of a stage leave alone whom no boundary is near
        for _ in range(_ROUNDS):
            errors = NearErrors.of(subspaces, vectors, labels, near, moving)
            labels = sweep(errors.of_all, labels, corners, clusters, prices, moving)
            subspaces = fit(labels)
            moving = faces[draws(labels, faces) > 1].unique()
        labels = sweep_patches(subspaces, vectors, labels, near, simplices, prices)
        subspaces = fit(labels)
        error = float(subspaces.own(vectors, labels).double().mean())
        least = min(least, error)
        stages.append((now, error, overdraw(labels, faces)))
        if price is not None or (error <= limit and error <= (1 + slack) * least):
            best = PricedPartition(labels, error, now, stages)
        elif error > (1 + _HOPELESS * slack) * least or (best.price == 0.0 and error > _RISING * least):
            break  # nearer than that, a later stage may well fall below the bound again
    return best


def by_overdraw(vectors: torch.Tensor, options: ClusterOptions, *, edges: bool = False) -> Clustering:
    """The method "k-subspaces-overdraw": from the first start that leads below the error of `lbg`."""
    starts, rounds = subspace_starts(vectors, options)
    limit = float("inf")
    if options.coherence is None:
        plain = fit_subspaces(vectors, starts[-1], int(starts[-1].max()) + 1, options.components)
        limit = _BELOW_LBG * float(plain.own(vectors, starts[-1]).double().mean())
    for start in starts:
        few = min(options.iterations, FEW_ROUNDS)
        first = k_subspaces(vectors, start, options.components, iterations=few)
        rounds += first.iterations
        found = price_overdraw(
            vectors,
            first.labels,
            options.faces,
            first.subspaces,
            price=options.coherence,
            limit=limit,
            slack=options.slack,
            per_pass=options.per_pass,
            edges=edges,
        )
        if found.error <= limit:
            break
    return Clustering(found.labels, rounds, found.price)


def by_edges(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "k-subspaces-potts"."""
    return by_overdraw(vectors, options, edges=True)


def _edges(faces: torch.Tensor) -> torch.Tensor:
    """Edges int64 [E, 3] as triangles that repeat their second corner."""
    pairs = torch.cat([faces[:, :2], faces[:, 1:], faces[:, ::2]]).sort(1).values.unique(dim=0)
    return torch.cat([pairs, pairs[:, 1:]], dim=1)


def _regroup(
    labels: torch.Tensor, faces: torch.Tensor, per_pass: int, clusters: int, groups: torch.Tensor | None
) -> torch.Tensor:
    """The pass of every cluster, going on from what they were; empty clusters stay where they are."""
    found = super_clusters(torch.cat([labels, torch.arange(clusters)]), faces, per_pass, groups=groups)
    return found.groups
