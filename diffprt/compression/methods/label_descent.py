"""Descent on error plus price times overdraw over a mesh: a color of receivers at a time, then patches as one.

A patch is a connected set of receivers of one label, which moves as one where no receiver would move alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from diffprt.compression.clusters.near import NearErrors
from diffprt.compression.clusters.partition import member_sums, members
from diffprt.compression.clusters.subspaces import Subspaces
from diffprt.compression.overdraw.corners import Corners

_CELLS = 1 << 22


def sweep(
    cost: Callable[[torch.Tensor], torch.Tensor],
    labels: torch.Tensor,
    corners: Corners,
    clusters: int,
    prices: list[tuple[float, torch.Tensor]],
    units: torch.Tensor | None = None,
) -> torch.Tensor:
    """Gives every unit the label of least cost + price times overdraw, given those of its neighbors.

    The overdraw is eq. 8 itself (the number of different labels of each triangle), not its pairwise stand-in: a
    unit pays for each of its triangles in which neither other corner has its label. No sweep raises the total.

    Args:
        cost: squared errors [U', M] of the units int64 [U'] that it is given, for every label; its
            result is written to.
        labels: int64 [U], changed by none; the new ones are returned.
        corners: of the mesh of units.
        clusters: M.
        prices: pairs of a price per extra drawn triangle, and the group int64 [M] that each label is drawn
            with: `arange(M)` for clusters, the super-cluster of each for super-clusters.
        units: int64 [U'], those that may change; all without.
    """
    labels = labels.clone()
    row_of = torch.full_like(labels, -1)
    units = torch.arange(len(labels)) if units is None else units
    row_of[units] = 0
    asking = (row_of[corners.unit] == 0).nonzero().flatten()
    units_of = [units[own] for own in members(corners.color_of_unit[units], corners.colors)]
    corners_of = [asking[own] for own in members(corners.color_of_unit[corners.unit[asking]], corners.colors)]
    step = max(1, _CELLS // clusters)
    for color_units, color_corners in zip(units_of, corners_of, strict=True):
        row_of[color_units] = torch.arange(len(color_units))
        rows = row_of[corners.unit[color_corners]]
        first, second = labels[corners.first[color_corners]], labels[corners.second[color_corners]]
        for low in range(0, len(color_units), step):
            chosen = color_units[low : low + step]
            total = cost(chosen)
            here = ((rows >= low) & (rows < low + step)).nonzero().flatten()
            row, one, two = rows[here] - low, first[here], second[here]
            for price, group in prices:
                _spare(total, price, row, group[one], group[two], group)
            labels[chosen] = total.argmin(1)
    return labels


def _spare(
    total: torch.Tensor, price: float, row: torch.Tensor, first: torch.Tensor, second: torch.Tensor, group: torch.Tensor
) -> None:
    """Takes off `total` [rows, M] what each label spares each unit: triangles with another corner of its group."""
    clusters, groups = len(group), int(group.max()) + 1
    apart = second != first
    row, found = torch.cat([row, row[apart]]), torch.cat([first, second[apart]])
    saved = total.new_full((1,), -price).expand(len(row))
    if groups == clusters and bool((group[1:] > group[:-1]).all()):
        total.view(-1).scatter_add_(0, row * clusters + found, saved)
        return
    spared = total.new_zeros(len(total), groups)
    spared.view(-1).scatter_add_(0, row * groups + found, saved)
    total += spared[:, group]


def patches(labels: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """The connected patch of equal labels int64 [V] that each receiver belongs to; faces int64 [F, 3]."""
    a, b = torch.cat([faces[:, :2], faces[:, 1:], faces[:, ::2]]).unbind(1)
    same = labels[a] == labels[b]
    rows, columns = a[same].numpy(), b[same].numpy()
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(labels), len(labels)))
    return torch.from_numpy(connected_components(graph, directed=False)[1].astype(np.int64))


def islands(patch: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """The patches int64 [I] that are not the largest of their label; of receivers' patch and label int64 [V]."""
    sizes = torch.bincount(patch)
    of_patch = torch.empty_like(sizes)
    of_patch[patch] = labels
    order = torch.from_numpy(np.lexsort((-sizes.numpy(), of_patch.numpy())))
    later = torch.zeros(len(sizes), dtype=torch.bool)
    later[order[1:]] = of_patch[order[1:]] == of_patch[order[:-1]]
    return later.nonzero().flatten()


def sweep_patches(
    subspaces: Subspaces,
    vectors: torch.Tensor,
    labels: torch.Tensor,
    near: torch.Tensor,
    faces: torch.Tensor,
    prices: list[tuple[float, torch.Tensor]],
) -> torch.Tensor:
    """`sweep` over islands: each joins what surrounds it if that costs less than its shore.

    Args:
        subspaces: of the clusters.
        vectors: float [V, D].
        labels: int64 [V].
        near: int64 [M, N], as `near_clusters`.
        faces: int64 [F, 3].
        prices: as for `sweep`.

    Returns:
        labels int64 [V]; the total never rises.
    """
    patch = patches(labels, faces)
    count = int(patch.max()) + 1
    of_patch = torch.empty(count, dtype=torch.int64)
    of_patch[patch] = labels
    moving = islands(patch, labels)
    inside = torch.isin(patch, moving).nonzero().flatten()
    errors = NearErrors.of(subspaces, vectors, labels, near, inside).errors
    summed = member_sums(errors[inside], patch[inside], count)
    corners = Corners.of(patch[faces], count)
    whole = NearErrors(of_patch, near, summed)
    return sweep(whole.of_all, of_patch, corners, len(near), prices, moving)[patch]
