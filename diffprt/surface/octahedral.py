"""Unit vectors as two codes of 16 bits: octahedral maps (Cigolle et al. 2014), for pages and for assets in few bits."""

from __future__ import annotations

import numpy as np

_MOST = 32767


def octahedral(normals: np.ndarray) -> np.ndarray:
    """Codes uint16 [V, 2] of unit vectors [V, 3]: z and x on the octahedron whose lower half, y < 0, is folded out.

    The sign of z is kept exactly: it chooses a glossy vertex's axes (`diffprt.transfer.glossy.mirrored`).
    """
    wide = normals.astype(np.float64)
    size = np.abs(wide).sum(axis=1, keepdims=True)
    wide = np.where(size > 0, wide / np.where(size > 0, size, 1.0), (0.0, 1.0, 0.0))
    flat = wide[:, [2, 0]]
    signs = np.where(flat < 0, -1.0, 1.0)
    below = wide[:, 1] < 0
    folded = np.where(below[:, None], (1 - np.abs(flat[:, ::-1])) * signs, flat)
    codes = np.rint(folded * _MOST)
    # Rounding must neither bring a negative z to zero nor the other one to the corner where z is zero.
    negative = flat[:, 0] < 0
    codes[negative, 0] = np.minimum(codes[negative, 0], -1)
    codes[negative, 1] = np.clip(codes[negative, 1], 1 - _MOST, _MOST - 1)
    return (codes + _MOST).astype(np.uint16)


def unfolded(codes: np.ndarray) -> np.ndarray:
    """The unit vectors, float32 [V, 3], of `codes` uint16 [V, 2]; they are not changed by another round."""
    z, x = (codes.astype(np.float64) / _MOST - 1).T
    y = 1 - np.abs(z) - np.abs(x)
    below = y < 0
    z, x = (
        np.where(below, (1 - np.abs(x)) * np.where(z < 0, -1, 1), z),
        np.where(below, (1 - np.abs(z)) * np.where(x < 0, -1, 1), x),
    )
    wide = np.stack([x, y, z], axis=1)
    return (wide / np.linalg.norm(wide, axis=1, keepdims=True)).astype(np.float32)
