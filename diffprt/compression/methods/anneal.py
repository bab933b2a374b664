"""Soft assignment that cools down: mean-field descent on expected error + price times expected overdraw."""

from __future__ import annotations

import torch

from diffprt.compression.clusters.partition import Clustering, member_sums
from diffprt.compression.clusters.subspaces import Subspaces, fit_subspaces
from diffprt.compression.methods.k_subspaces import FEW_ROUNDS, k_subspaces, subspace_starts
from diffprt.compression.overdraw.corners import Corners
from diffprt.compression.overdraw.overdraw import soft_assignment
from diffprt.options.compress import ClusterOptions

_CELLS = 1 << 22
_PRICE = 0.5
_WARMEST, _COLDEST, _ROUNDS = 0.5, 0.01, 12


def anneal(
    vectors: torch.Tensor, labels: torch.Tensor, faces: torch.Tensor, subspaces: Subspaces, *, price: float
) -> torch.Tensor:
    """Labels of an assignment that starts soft and ends hard, refitting subspaces as it cools.

    Every round gives each receiver the softmax of minus its cost: squared error, less the price of the draws that
    its neighbors' probabilities would spare it (the derivative of `expected_overdraw`). Half of the old assignment
    is kept, or neighbors that change at once would overshoot. Temperatures fall from half the mean squared error
    to a hundredth of it.

    Args:
        vectors: float [V, D].
        labels: int64 [V], where to start.
        faces: int64 [F, 3].
        subspaces: of the clusters.
        price: of one extra drawn triangle, in mean squared errors of the start.

    Returns:
        labels int64 [V]; clusters may be empty.
    """
    clusters, components = subspaces.bases.shape[:2]
    corners = Corners.of(faces, len(vectors))
    order = corners.unit.argsort(stable=True)
    unit, first, second = corners.unit[order], corners.first[order], corners.second[order]
    scale = float(subspaces.own(vectors, labels).double().mean())
    assignment = torch.nn.functional.one_hot(labels, clusters).to(vectors.dtype)
    for step in range(_ROUNDS if scale > 0 else 0):
        temperature = scale * _WARMEST * (_COLDEST / _WARMEST) ** (step / (_ROUNDS - 1))
        cost = -price * scale * spared_draws(assignment, unit, first, second)
        for rows, residual in subspaces.blocks(vectors):
            cost[rows] += residual
        assignment = (assignment + soft_assignment(cost, temperature)) / 2
        labels = assignment.argmax(1)
        subspaces = fit_subspaces(vectors, labels, clusters, components, bases=subspaces.bases)
    return labels


def spared_draws(
    assignment: torch.Tensor, unit: torch.Tensor, first: torch.Tensor, second: torch.Tensor
) -> torch.Tensor:
    """Draws [V, M] that each label is expected to spare each receiver: sum of 1 - (1 - q_first) (1 - q_second).

    Args:
        assignment: float [V, M].
        unit, first, second: int64 [N], corners of triangles sorted by `unit`, with the two others.
    """
    spared = torch.zeros_like(assignment)
    step = max(1, _CELLS // assignment.shape[1])
    for low in range(0, len(unit), step):
        rows = unit[low : low + step]
        one, two = assignment[first[low : low + step]], assignment[second[low : low + step]]
        start, end = int(rows[0]), int(rows[-1]) + 1
        spared[start:end] += member_sums(one + two - one * two, rows - start, end - start)
    return spared


def by_annealing(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "k-subspaces-soft"."""
    starts, rounds = subspace_starts(vectors, options)
    price = _PRICE if options.coherence is None else options.coherence
    few = min(options.iterations, FEW_ROUNDS)
    first = k_subspaces(vectors, starts[0], options.components, iterations=few)
    labels = anneal(vectors, first.labels, options.faces, first.subspaces, price=price)
    return Clustering(labels, rounds + first.iterations, price)
