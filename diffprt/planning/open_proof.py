"""Proof that nothing shadows anything: the whole scene lies below the tangent plane of every receiver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# A tenth of the height at which rays start (`TriangleMesh.ray_offset` is at least 1e-5 diagonals).
_CLEARANCE = 1e-6
# Receivers times corners of the hull that a proof may compare: about two seconds. Beyond it, pilot rays are cheaper.
_MOST_COMPARISONS = 500_000_000
_BLOCK = 4_000_000


@dataclass(frozen=True)
class OpenProof:
    """Whether every receiver is proved open.

    Attributes:
        proved: no ray above the horizon of any receiver hits anything.
        rise: how far the scene was seen to rise above a tangent plane [diagonals of the scene]; negative when
            all of it lies below.
        hull_corners: corners of the convex hull; 0 when the proof failed before it was built.
    """

    proved: bool
    rise: float
    hull_corners: int


def prove_open(points: np.ndarray, normals: np.ndarray, faces: np.ndarray, receives: np.ndarray) -> OpenProof:
    """Tries to prove that no receiver's upper hemisphere holds any geometry.

    A ray that starts at height o > 0 above the tangent plane of receiver v and goes up never comes below o. So
    it hits nothing if n_v · (p - x_v) <= c < o for every vertex p of the scene: triangles are convex combinations
    of vertices. This is what convexity gives, smooth normals included, and it is asked here directly: in that
    form it also holds for open sheets and for several objects.

    Three tests, from cheap to dear:

    1. The other corners of a receiver's own triangles. Necessary, O(F); everything with a dent fails here.
    2. Receivers at a corner of the convex hull: only its neighbours along edges of the hull. A linear function
       that no neighbour improves is largest over the whole polytope (the simplex method's optimality test), so
       local is global, in O(H).
    3. Other receivers (inside a flat face, or within the hull): all corners of the hull.

    Slack c is `_CLEARANCE` diagonals, so rounding neither makes nor breaks a proof.

    Args:
        points, normals: float [V, 3], every vertex of the scene.
        faces: int [F, 3].
        receives: bool [V], the vertices that are receivers.
    """
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    low, high = points.min(0), points.max(0)
    diagonal = max(float(np.linalg.norm(high - low)), 1e-300)
    points = (points - (low + high) / 2) / diagonal

    rise = -np.inf
    for a in range(3):
        own = receives[faces[:, a]]
        here = faces[own, a]
        for b in ((a + 1) % 3, (a + 2) % 3):
            rise = max(rise, _highest(normals[here], points[faces[own, b]] - points[here]))
    if rise > _CLEARANCE:
        return OpenProof(False, rise, 0)

    corners, edges = _hull(points)
    is_corner = np.zeros(len(points), bool)
    if len(edges):
        is_corner[corners] = True
        edges = edges[receives[edges[:, 0]]]
        rise = max(rise, _highest(normals[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]))
    if rise > _CLEARANCE:
        return OpenProof(False, rise, len(corners))

    rest = np.flatnonzero(receives & ~is_corner)
    if len(rest) * len(corners) > _MOST_COMPARISONS:
        return OpenProof(False, rise, len(corners))
    for block in np.array_split(rest, max(1, len(rest) * len(corners) // _BLOCK)):
        if len(block):
            support = (normals[block] @ points[corners].T).max(1)
            rise = max(rise, float((support - (normals[block] * points[block]).sum(1)).max()))
        if rise > _CLEARANCE:
            break
    return OpenProof(rise <= _CLEARANCE, rise, len(corners))


def _highest(normals: np.ndarray, offsets: np.ndarray) -> float:
    """The largest height of `offsets` above the planes of `normals`."""
    return float((normals * offsets).sum(1).max(initial=-np.inf))


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the convex hull, and its edges in both directions as [E, 2] indices of points.

    A flat scene has a hull in its plane, and no edges are given: test 3 then compares all its corners.
    """
    from scipy.spatial import ConvexHull, QhullError

    none = np.zeros((0, 2), np.int64)
    try:
        hull = ConvexHull(points)
    except QhullError:
        _, extents, axes = np.linalg.svd(points - points.mean(0), full_matrices=False)
        if extents[2] > 1e-9 * extents[0]:
            return np.arange(len(points)), none
        try:
            return ConvexHull(points @ axes[:2].T).vertices, none
        except QhullError:
            return np.arange(len(points)), none
    s = hull.simplices
    edges = np.concatenate([s[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    return hull.vertices, np.unique(edges, axis=0)
