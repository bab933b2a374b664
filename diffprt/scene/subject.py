"""What a picture is of: the object, not the ground under it."""

from __future__ import annotations

import torch

# Of the diagonal: points that are so much higher than the lowest one lie in another plane.
_LEVEL = 1e-6
# A ground covers so many times the area, seen from above, of what stands on it.
_WIDER = 1.2
_UPRIGHT = 0.999


def is_ground(positions: torch.Tensor, normals: torch.Tensor) -> torch.Tensor:
    """Which points belong to a ground, bool [V]: a level plane, seen from above, under all the rest and wider.

    Assets do not say which of their receivers were the ground of their scene, and files bring their own grounds.
    Nowhere true where there is no such plane, or nothing on it.

    Args:
        positions: [V, 3], scene units, +y up.
        normals: [V, 3], unit.
    """
    points = positions.detach().double()
    low, high = points.amin(0), points.amax(0)
    lowest = points[:, 1] <= low[1] + _LEVEL * (high - low).norm()
    found = lowest & (normals.detach()[:, 1] > _UPRIGHT)
    none = torch.zeros_like(found)
    if not bool(found.any()) or bool((lowest & ~found).any()) or bool(found.all()):
        return none
    (ground_low, ground_high), (low, high) = (_level_box(points[rows]) for rows in (found, ~found))
    around = bool((ground_low <= low).all() and (ground_high >= high).all())
    wide, needed = (ground_high - ground_low).prod(), (high - low).prod()
    return found if around and float(wide) > _WIDER * float(needed) else none


def _level_box(points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Least and greatest x and z."""
    return points[:, ::2].amin(0), points[:, ::2].amax(0)
