"""The least value of a band-limited function on the sphere."""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.sh.basis import basis, order_of_count
from diffprt.sh.maps import map_directions, render_map

# Grid rows per band; a period of the highest band then spans 16 rows, so every basin holds a grid point.
ROWS_PER_BAND = 8
CANDIDATES = 24
# The error of the value is of second order in the step.
SMALLEST_STEP = 1e-7


def sphere_minimum(coefficients: torch.Tensor) -> tuple[float, torch.Tensor, int]:
    """Least value over all directions and channels, and where it is.

    The local minima of a dense grid are refined together by a pattern search on the tangent plane. The value
    is good to about 1e-12 of the function's size. For a maximum give the negated coefficients.

    Args:
        coefficients: float [K, C], K = order², finite.
    Returns:
        value, unit direction float64 [3], channel. Carries no gradient: by the envelope theorem the gradient
        of the value is that of `evaluate` at the direction.
    Raises:
        InputError: coefficients not finite, or not [K, C] with K = order² of an order in 1..10.
    """
    if coefficients.dim() != 2:
        raise InputError(f"coefficients have shape {list(coefficients.shape)}: give [K, C]")
    if not torch.isfinite(coefficients).all():
        raise InputError("coefficients hold NaN or infinite numbers: project a map without such texels")
    coefficients = coefficients.detach().double()
    order = order_of_count(coefficients.shape[0])
    height, width = ROWS_PER_BAND * (order + 1), 2 * ROWS_PER_BAND * (order + 1)
    grid = render_map(coefficients, height, width).permute(2, 0, 1)
    padded = torch.nn.functional.pad(grid[None], (1, 1, 0, 0), mode="circular")
    padded = torch.nn.functional.pad(padded, (0, 0, 1, 1), mode="replicate")
    lowest = -torch.nn.functional.max_pool2d(-padded, 3, stride=1)[0]
    scores = torch.where(grid <= lowest, grid, torch.inf).reshape(-1)
    chosen = scores.topk(min(CANDIDATES, scores.numel()), largest=False).indices
    channels = chosen // (height * width)
    centres = map_directions(height, width, torch.float64).reshape(-1, 3).to(grid.device)
    points = centres[chosen % (height * width)]
    values, points = _descend(coefficients[:, channels], points, order, torch.pi / height)
    best = int(values.argmin())
    return float(values[best]), points[best], int(channels[best])


def _descend(
    coefficients: torch.Tensor, points: torch.Tensor, order: int, step: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Move each of the points [N, 3] to the local minimum of its own function [K, N]."""
    angles = torch.arange(8, dtype=points.dtype, device=points.device) * (torch.pi / 4)
    ring = torch.stack([angles.cos(), angles.sin()], dim=-1)
    offsets = torch.cat([ring.new_zeros(1, 2), ring, ring / 2])
    steps = torch.full_like(points[:, :1, None], step)
    index = torch.arange(points.shape[0], device=points.device)
    while float(steps.max()) > SMALLEST_STEP:
        # Any vector that is not parallel will do for a tangent frame: the axis of the smallest component.
        axis = torch.nn.functional.one_hot(points.abs().argmin(-1), 3).to(points)
        tangent = torch.nn.functional.normalize(torch.linalg.cross(points, axis), dim=-1)
        frame = torch.stack([tangent, torch.linalg.cross(points, tangent)], dim=-2)
        trials = torch.nn.functional.normalize(points[:, None] + steps * offsets @ frame, dim=-1)
        values = torch.einsum("npk,kn->np", basis(trials, order), coefficients)
        best = values.argmin(-1)
        points, least = trials[index, best], values[index, best]
        # A point that strides along its outer ring is still on its way, the others look closer. The stride
        # shrinks all the same: along a valley (the ring about a lobe) it would never end.
        striding = (best >= 1) & (best <= 8)
        steps = steps * torch.where(striding, 0.7, 0.3).to(steps)[:, None, None]
    return least, points
