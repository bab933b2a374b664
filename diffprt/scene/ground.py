"""A ground for the object to stand on: it receives the object's shadow and reflects light back."""

from __future__ import annotations

import numpy as np

from diffprt.errors import InputError
from diffprt.scene.mesh import Mesh

# Share of the linear term in the grading: cells are three times finer at the centre than evenly spaced ones.
_EVEN = 1 / 3
# The ground lies this share of the diagonal lower, so that a flat underside does not coincide with it.
_GAP = 1e-4


def ground_mesh(bounds: np.ndarray, *, size: float, resolution: int, clearance: float, material: int) -> Mesh:
    """A square of (resolution + 1)² vertices facing +y under `bounds` [2, 3], finer under the centre.

    Args:
        bounds: least and greatest corner of what stands on it, scene units.
        size: length of a side, in diagonals of the bounds.
        resolution: cells along a side, 1..4096.
        clearance: distance below the lowest point, in diagonals; a ten-thousandth is always added.
        material: index of its material.
    """
    if not (size > 0 and np.isfinite(size)):
        raise InputError(f"ground has size {size:g} diagonals: give more than 0")
    if not 1 <= resolution <= 4096:
        raise InputError(f"ground has resolution {resolution}: give 1 to 4096")
    if not (clearance >= 0 and np.isfinite(clearance)):
        raise InputError(f"ground has clearance {clearance:g} diagonals: give 0 or more")
    low, high = np.asarray(bounds, dtype=np.float64)
    diagonal = float(np.linalg.norm(high - low))
    center = (low + high) / 2
    even = np.linspace(-1, 1, resolution + 1)
    graded = (_EVEN * even + (1 - _EVEN) * even**3) * size * diagonal / 2
    x, z = np.meshgrid(center[0] + graded, center[2] + graded)
    y = np.full_like(x, low[1] - (clearance + _GAP) * diagonal)
    positions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return Mesh.create(
        positions,
        grid_faces(resolution, resolution),
        np.broadcast_to([0.0, 1.0, 0.0], positions.shape),
        material=material,
        name="ground",
        ground=True,
    )


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles [2 rows columns, 3] of a grid of (rows + 1) x (columns + 1) vertices, row by row.

    With columns along a and rows along b they face a x b reversed: +y for a = +x, b = +z.
    """
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    right, below = corner + 1, corner + columns + 1
    upper = np.stack([corner, below, right], axis=1)
    lower = np.stack([right, below, below + 1], axis=1)
    return np.stack([upper, lower], axis=1).reshape(-1, 3).astype(np.int64)
