"""Who shares triangles with whom: what a change of one label does to the overdraw around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_matrix


@dataclass(frozen=True)
class Corners:
    """Corners of triangles, each with the two others, sorted by the color of the receiver that they belong to.

    Receivers of one color share no triangle, so all of them may change label at once and each sees what it gets.

    Attributes:
        unit: int64 [N], the receiver (or patch of receivers) of the corner.
        first, second: int64 [N], the two others; the same where the triangle has only one other.
        members: int64 [U], all units, sorted by color.
        color_of_unit: int64 [U].
    """

    unit: torch.Tensor
    first: torch.Tensor
    second: torch.Tensor
    color_of_unit: torch.Tensor

    @property
    def colors(self) -> int:
        """Number of colors."""
        return int(self.color_of_unit.max()) + 1 if len(self.color_of_unit) else 0

    @staticmethod
    def of(faces: torch.Tensor, units: int, *, seed: int = 0) -> Corners:
        """Corners of triangles `faces` int64 [F, 3] over `units` receivers.

        Triangles may repeat a corner, as those between patches do; those with one corner alone say nothing.
        """
        a, b, c = faces.unbind(1)
        corner = torch.cat([torch.stack([a, b, c], 1), torch.stack([b, c, a], 1), torch.stack([c, a, b], 1)])
        unit, first, second = corner.unbind(1)
        face = torch.arange(len(faces)).repeat(3)
        # a corner that repeats in its triangle counts once, and sees the one other twice
        first, second = torch.where(first == unit, second, first), torch.where(second == unit, first, second)
        alone = (first == unit) & (second == unit)
        key = face * max(units, 1) + unit
        order = key.argsort(stable=True)
        repeated = torch.zeros_like(alone)
        repeated[order[1:]] = key[order[1:]] == key[order[:-1]]
        keep = (~alone & ~repeated).nonzero().flatten()
        unit, first, second = unit[keep], first[keep], second[keep]
        return Corners(unit, first, second, _colors(unit, first, second, units, seed))


def _colors(unit: torch.Tensor, first: torch.Tensor, second: torch.Tensor, units: int, seed: int) -> torch.Tensor:
    """A coloring in which units that share a triangle differ: rounds of local maxima (Jones and Plassmann 1993)."""
    rows, columns = torch.cat([unit, unit]).numpy(), torch.cat([first, second]).numpy()
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(units, units)).tocsr()
    degree = np.diff(graph.indptr)
    # ties of degree are broken at random; every unit's number is its own
    rank = np.empty(units, dtype=np.int64)
    rank[np.lexsort((np.random.default_rng(seed).permutation(units), degree))] = np.arange(units)
    edge_from = np.repeat(np.arange(units), degree)
    edge_to = graph.indices
    color = np.full(units, -1, dtype=np.int64)
    while (color < 0).any():
        waiting = (color[edge_from] < 0) & (color[edge_to] < 0)
        edge_from_open, edge_to_open = edge_from[waiting], edge_to[waiting]
        beaten = np.zeros(units, dtype=bool)
        beaten[edge_from_open[rank[edge_from_open] < rank[edge_to_open]]] = True
        chosen = (color < 0) & ~beaten
        # the lowest color that no neighbor has: up to 63 as bits, beyond that the highest neighbor's plus one
        taken = np.zeros(units, dtype=np.uint64)
        near = chosen[edge_from] & (color[edge_to] >= 0)
        low = near & (color[edge_to] < 63)
        np.bitwise_or.at(taken, edge_from[low], np.uint64(1) << color[edge_to[low]].astype(np.uint64))
        highest = np.full(units, 62, dtype=np.int64)
        np.maximum.at(highest, edge_from[near], color[edge_to[near]])
        free = ~taken & (taken + np.uint64(1))
        lowest = np.log2(np.maximum(free, np.uint64(1)).astype(np.float64)).astype(np.int64)
        color[chosen] = np.where(lowest < 63, lowest, highest + 1)[chosen]
    return torch.from_numpy(color)
