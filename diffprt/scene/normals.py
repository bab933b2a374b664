"""Smooth vertex normals."""

from __future__ import annotations

import numpy as np


def position_groups(positions: np.ndarray) -> np.ndarray:
    """One group number per vertex, int64 [V]: vertices at exactly the same position share it.

    The number is that of the group's first vertex in the order of the file.
    """
    count = len(positions)
    keys = np.ascontiguousarray(positions, dtype=np.float32) + np.float32(0)  # -0.0 becomes 0.0
    keys = keys.view(np.int32)
    order = np.lexsort((keys[:, 2], keys[:, 1], keys[:, 0]))
    ordered = keys[order]
    starts = np.ones(count, dtype=bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    # lexsort is stable, so the first of a run is the lowest index.
    groups = np.empty(count, dtype=np.int64)
    groups[order] = order[starts][np.cumsum(starts) - 1]
    return groups


def smooth_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Angle-weighted vertex normals (Thürmer and Wüthrich 1998), without creases.

    Vertices at exactly the same position (seams) get the same normal, unless its sum cancels, as on a
    two-sided sheet: then each keeps the sum of its own faces. A vertex without faces, or with zero-area
    faces only, gets +y.

    Args:
        positions: float [V, 3].
        faces: int64 [F, 3].

    Returns:
        float32 [V, 3], unit.
    """
    count = len(positions)
    corners = positions.astype(np.float64)[faces]
    edges = [corners[:, (i + 1) % 3] - corners[:, i] for i in range(3)]
    face_normals = np.cross(edges[0], -edges[2])
    lengths = np.linalg.norm(face_normals, axis=1, keepdims=True)
    face_normals = np.divide(face_normals, lengths, out=np.zeros_like(face_normals), where=lengths > 0)
    own = np.zeros((count, 3))
    for i in range(3):
        one, two = edges[i], -edges[i - 1]
        angle = np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.einsum("fi,fi->f", one, two))
        own += _sum_at(faces[:, i], angle[:, None] * face_normals, count)
    groups = position_groups(positions)
    shared = _sum_at(groups, own, count)[groups]
    for fallback in (own, np.broadcast_to([0.0, 1.0, 0.0], own.shape)):
        cancelled = np.linalg.norm(shared, axis=1) < 1e-6
        shared[cancelled] = fallback[cancelled]
    return (shared / np.linalg.norm(shared, axis=1, keepdims=True)).astype(np.float32)


def _sum_at(indices: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(indices, weights=values[:, k], minlength=count) for k in range(3)], axis=1)
