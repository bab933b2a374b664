"""What 32-bit coordinates can hold: how finely a mesh far from the origin is resolved."""

from __future__ import annotations

import numpy as np

from diffprt.errors import InputError

# A face whose longest edge spans fewer steps of its own coordinates has lost its shape.
_FEWEST_STEPS = 4
# Steps at the largest coordinate that rays start above a surface (`diffprt.kernels.TriangleMesh.ray_offset`), as a
# share of the scene's size: worth a remark, and too much.
_RAY_START_STEPS, _REMARK, _REFUSAL = 16, 1e-3, 0.1
_REMEDY = "move it to the origin, in 64-bit coordinates (--recenter, or recenter=True in Python)"


def unresolved_faces(positions: np.ndarray, faces: np.ndarray) -> tuple[int, str]:
    """How many faces 32-bit coordinates cannot hold, and what to say when they are too many.

    Args:
        positions: float [V, 3], finite, before rounding.
        faces: int [F, 3].

    Returns:
        the count, and the figures in words; these are empty unless the count is more than half of the faces.
    """
    corners = np.asarray(positions, dtype=np.float64)[faces]
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    magnitude = np.abs(corners).max(axis=(1, 2))
    unresolved = longest < _FEWEST_STEPS * np.spacing(magnitude.astype(np.float32)).astype(np.float64)
    # Faces without any extent are degenerate at any resolution.
    unresolved &= longest > 0
    count = int(unresolved.sum())
    if 2 * count <= len(faces):
        return count, ""
    largest = float(magnitude.max())
    return count, (
        f"coordinates up to {largest:.6g}, where 32-bit steps are {np.spacing(np.float32(largest)):.3g}, and edges of "
        f"{np.median(longest):.3g} ({count} of {len(faces)} faces are lost): {_REMEDY}"
    )


def offset_remark(low: np.ndarray, high: np.ndarray, name: str) -> str:
    """A remark on a scene with the bounds `low`, `high` [3] that lies far from the origin for its size, or "".

    Raises:
        InputError: rays would start more than a tenth of the scene's size above its surfaces.
    """
    low, high = (np.asarray(bound, dtype=np.float64) for bound in (low, high))
    magnitude, size = float(max(np.abs(low).max(), np.abs(high).max())), float(np.linalg.norm(high - low))
    step = 2.0**-23 * magnitude
    start = _RAY_START_STEPS * step
    if start <= _REMARK * size:
        return ""
    found = (
        f"'{name}' is {size:.3g} large with coordinates up to {magnitude:.6g}, where 32-bit steps are up to "
        f"{step:.3g} and rays start {start:.3g} above surfaces"
    )
    if start > _REFUSAL * size:
        raise InputError(f"{found}: {_REMEDY}")
    return f"{found} ({100 * start / size:.2g} % of its size): {_REMEDY}"
