"""One round of descent on error plus price times overdraw, over a mesh, one color of receivers at a time."""

from __future__ import annotations

from collections.abc import Callable

import torch

from diffprt.compress.corners import Corners

_CELLS = 1 << 22


def sweep(
    cost: Callable[[torch.Tensor], torch.Tensor],
    labels: torch.Tensor,
    corners: Corners,
    clusters: int,
    prices: list[tuple[float, torch.Tensor]],
) -> torch.Tensor:
    """Gives every unit the label of least cost + price times overdraw, given those of its neighbors.

    The overdraw is eq. 8 itself (the number of different labels of each triangle), not its pairwise stand-in: a
    unit pays for each of its triangles in which neither other corner has its label. No sweep raises the total.

    Args:
        cost: squared errors [U', M] of the units int64 [U'] that it is given, for every label.
        labels: int64 [U], changed by none; the new ones are returned.
        corners: of the mesh of units.
        clusters: M.
        prices: pairs of a price per extra drawn triangle, and the group int64 [M] that each label is drawn
            with: `arange(M)` for clusters, the super-cluster of each for super-clusters.
    """
    labels = labels.clone()
    order = corners.color_of_unit.argsort(stable=True)
    corner_color = corners.color_of_unit[corners.unit]
    corner_order = corner_color.argsort(stable=True)
    units_of = order.split(torch.bincount(corners.color_of_unit, minlength=corners.colors).tolist())
    corners_of = corner_order.split(torch.bincount(corner_color, minlength=corners.colors).tolist())
    row_of = torch.empty_like(labels)
    step = max(1, _CELLS // clusters)
    for color_units, color_corners in zip(units_of, corners_of, strict=True):
        row_of[color_units] = torch.arange(len(color_units))
        rows = row_of[corners.unit[color_corners]]
        first, second = labels[corners.first[color_corners]], labels[corners.second[color_corners]]
        for low in range(0, len(color_units), step):
            units = color_units[low : low + step]
            total = cost(units)
            here = ((rows >= low) & (rows < low + step)).nonzero().flatten()
            row, one, two = rows[here] - low, first[here], second[here]
            for price, group in prices:
                total = total - price * _saved(row, group[one], group[two], len(units), group)
            labels[units] = total.argmin(1)
    return labels


def _saved(
    row: torch.Tensor, first: torch.Tensor, second: torch.Tensor, rows: int, group: torch.Tensor
) -> torch.Tensor:
    """How many draws [rows, M] each label spares each unit: triangles in which another corner is of its group."""
    groups = int(group.max()) + 1
    second_counts = second != first
    index = torch.cat([row * groups + first, (row * groups + second)[second_counts]])
    spared = torch.bincount(index, minlength=rows * groups).view(rows, groups).float()
    return spared if groups == len(group) and bool((group[1:] > group[:-1]).all()) else spared[:, group]
