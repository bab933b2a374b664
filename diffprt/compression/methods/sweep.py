"""One round of descent on error plus price times overdraw, over a mesh, one color of receivers at a time."""

from __future__ import annotations

from collections.abc import Callable

import torch

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
    units_of = _by_color(units, corners.color_of_unit[units], corners.colors)
    corners_of = _by_color(asking, corners.color_of_unit[corners.unit[asking]], corners.colors)
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


def _by_color(items: torch.Tensor, colors: torch.Tensor, count: int) -> tuple[torch.Tensor, ...]:
    return items[colors.argsort(stable=True)].split(torch.bincount(colors, minlength=count).tolist())


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
