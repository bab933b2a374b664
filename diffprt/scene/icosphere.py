"""An icosphere, vertex for vertex that of trimesh, which takes longer to load than a small scene takes to bake."""

from __future__ import annotations

import numpy as np

_SHORT, _LONG = 0.5257311121191336, 0.85065080835204
_FACES = """
    0 11 5  0 5 1  0 1 7  0 7 10  0 10 11  1 5 9  5 11 4  11 10 2  10 7 6  7 1 8
    3 9 4  3 4 2  3 2 6  3 6 8  3 8 9  4 9 5  2 4 11  6 2 10  8 6 7  9 8 1
"""


def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64 [10 * 4^n + 2, 3] on the unit sphere and faces int64 [20 * 4^n, 3]."""
    rectangle = [(-_SHORT, _LONG, 0.0), (_SHORT, _LONG, 0.0), (-_SHORT, -_LONG, 0.0), (_SHORT, -_LONG, 0.0)]
    upright = [(0.0, x, z) for z in (_LONG, -_LONG) for x in (-_SHORT, _SHORT)]
    across = [(x, 0.0, z) for x in (_LONG, -_LONG) for z in (-_SHORT, _SHORT)]
    vertices, faces = np.array(rectangle + upright + across), np.array(_FACES.split(), dtype=np.int64).reshape(-1, 3)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, first, middle = np.unique(edges @ [1, len(vertices)], return_index=True, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = middle.reshape(-1, 3).T + len(vertices)
        faces = np.column_stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]).reshape(-1, 3)
        vertices = _onto_sphere(np.vstack([vertices, vertices[edges[first]].mean(axis=1)]))
    return (vertices if subdivisions else _onto_sphere(vertices)), faces


def _onto_sphere(vertices: np.ndarray) -> np.ndarray:
    length = np.sqrt(np.dot(vertices**2, [1, 1, 1])).reshape(-1, 1)
    return vertices + vertices / length * (1.0 - length)
