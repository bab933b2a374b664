"""Vertices from face corners: formats that index normals and uv apart from positions need some split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Welded:
    """Vertices made of corners.

    Attributes:
        faces: int64 [F, 3] into the new vertices.
        vertex: int64 [S], the position that each new vertex has.
        corner: int64 [S], a corner with its attributes; -1 for a position without corners.
    """

    faces: np.ndarray
    vertex: np.ndarray
    corner: np.ndarray

    def attribute(self, per_corner: np.ndarray) -> np.ndarray:
        """Values [S, k] at the new vertices, from values [N, k] at the corners; 0 without corners."""
        values = np.asarray(per_corner)[self.corner].copy()
        values[self.corner < 0] = 0
        return values


def weld(vertex: np.ndarray, attributes: np.ndarray, kept: np.ndarray) -> Welded:
    """One vertex per position, in the order of the file, and behind them one for each further attribute set.

    Args:
        vertex: int64 [N], position index of each corner; three corners a face.
        attributes: int64 [N, k], identifies the attributes of each corner.
        kept: int64 [P] ascending, the positions to keep; every one in `vertex` is among them.
    """
    keys = np.column_stack([vertex, attributes])
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    starts = np.ones(len(keys), dtype=bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    # lexsort is stable: the first corner of each run is its first appearance.
    first = order[starts]
    run_of_corner = np.empty(len(keys), dtype=np.int64)
    run_of_corner[order] = np.cumsum(starts) - 1

    by_appearance = np.argsort(first, kind="stable")
    positions = vertex[first[by_appearance]]
    leads = np.zeros(len(first), dtype=bool)
    leads[np.unique(positions, return_index=True)[1]] = True
    slot = np.empty(len(first), dtype=np.int64)
    slot[by_appearance[leads]] = np.searchsorted(kept, positions[leads])
    slot[by_appearance[~leads]] = len(kept) + np.arange((~leads).sum())

    corner = np.full(len(kept) + int((~leads).sum()), -1, dtype=np.int64)
    corner[slot] = first
    source = np.concatenate([kept, positions[~leads]])
    return Welded(slot[run_of_corner].reshape(-1, 3), source, corner)


def row_numbers(rows: np.ndarray, decimals: int | None = None) -> np.ndarray:
    """One number per distinct row, int64 [N]; floats are compared after rounding to `decimals`."""
    rows = np.asarray(rows) if decimals is None else np.round(np.asarray(rows, dtype=np.float64), decimals)
    order = np.lexsort(rows.T)
    ordered = rows[order]
    starts = np.ones(len(rows), dtype=bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.empty(len(rows), dtype=np.int64)
    numbers[order] = np.cumsum(starts) - 1
    return numbers
