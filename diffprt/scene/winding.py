"""Winding: which way each triangle faces, and how to make a surface agree with itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Topology:
    """Edges and connected pieces of a surface.

    Attributes:
        component: int64 [F], faces joined through edges of exactly two faces.
        component_count: how many there are.
        closed: bool [components]: every edge has exactly two faces.
        orientable: bool [components].
        boundary_edges, non_manifold_edges, inconsistent_edges: counts of edges with one face, with more than
            two, and with two faces that run along it in the same direction.
        flip: bool [F], the fewest flips that make every orientable component agree with itself.
    """

    component: np.ndarray
    component_count: int
    closed: np.ndarray
    orientable: np.ndarray
    boundary_edges: int
    non_manifold_edges: int
    inconsistent_edges: int
    flip: np.ndarray


def topology(faces: np.ndarray) -> Topology:
    """Edges and components of `faces` int64 [F, 3]; position groups in place of vertices close seams."""
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components

    count = len(faces)
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    forward = start < end
    key = np.minimum(start, end) * (int(faces.max(initial=0)) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    firsts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    sizes = np.diff(np.r_[firsts, len(ordered)])
    owner = order // 3
    pairs = firsts[sizes == 2]
    one, two = owner[pairs], owner[pairs + 1]
    same_way = forward[order[pairs]] == forward[order[pairs + 1]]

    # Each face is two nodes, as given and flipped. An edge joins the states that agree across it; a
    # component is orientable when no face reaches its own flipped state.
    rows = np.r_[one, one + count]
    columns = np.r_[np.where(same_way, two + count, two), np.where(same_way, two, two + count)]
    joined = sparse.coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, state = connected_components(joined, directed=False)
    kept, flipped = state[:count], state[count:]
    _, component = np.unique(np.minimum(kept, flipped), return_inverse=True)
    component_count = int(component.max(initial=-1)) + 1
    orientable = np.bincount(component, weights=kept == flipped, minlength=component_count) == 0

    # Of the two consistent states of a component, the one that holds most faces as given.
    side = kept > flipped
    minority = np.bincount(component, weights=side, minlength=component_count)
    majority = minority * 2 > np.bincount(component, minlength=component_count)
    flip = (side != majority[component]) & orientable[component]

    closed = np.ones(component_count, dtype=bool)
    lonely = np.repeat(sizes != 2, sizes)
    closed[component[owner[lonely]]] = False
    return Topology(
        component=component.astype(np.int64),
        component_count=component_count,
        closed=closed,
        orientable=orientable,
        boundary_edges=int((sizes == 1).sum()),
        non_manifold_edges=int((sizes > 2).sum()),
        inconsistent_edges=int(same_way.sum()),
        flip=flip,
    )


def flipped(faces: np.ndarray, which: np.ndarray) -> np.ndarray:
    """`faces` [F, 3] with those in `which` [F] turned over; the first corner stays first."""
    turned = faces.copy()
    turned[which] = turned[which][:, [0, 2, 1]]
    return turned


def signed_volumes(positions: np.ndarray, faces: np.ndarray, component: np.ndarray, count: int) -> np.ndarray:
    """Volume [count] enclosed by each component, negative when it faces inward; meaningful where closed."""
    corners = (positions.astype(np.float64) - positions.astype(np.float64).mean(axis=0))[faces]
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return np.bincount(component, weights=volumes, minlength=count)


def inward_components(positions: np.ndarray, faces: np.ndarray, surface: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Closed components that face inward: (turned inside out, cavities), bool [components] each.

    A cavity is the inner wall of a hollow solid: its box lies inside the box of a component that faces
    outward, and its winding is right as it is.
    """
    count = surface.component_count
    volumes = signed_volumes(positions, faces, surface.component, count)
    closed = surface.closed & surface.orientable
    inward = closed & (volumes < 0)
    cavities = np.zeros(count, dtype=bool)
    if inward.any() and (closed & ~inward).any():
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        corners = positions[faces]
        np.minimum.at(low, surface.component, corners.min(axis=1))
        np.maximum.at(high, surface.component, corners.max(axis=1))
        outer = np.flatnonzero(closed & ~inward)
        for index in np.flatnonzero(inward):
            within = (low[outer] <= low[index]).all(axis=1) & (high[outer] >= high[index]).all(axis=1)
            cavities[index] = bool(within.any())
    return inward & ~cavities, cavities
