"""Light and albedo told apart in closed form, up to their common scale.

A receiver with albedo a sends x_g = a T·L_g / pi under light g. With b = 1 / a this is linear in all unknowns and
homogeneous, b x_g - T·L_g / pi = 0, so that the lights are the null vector of a small matrix from which every b has
been eliminated, and no start is needed. The second smallest value tells how far the next best explanation is. One light
and an albedo of its own for every receiver leave every light possible: b = T·L / (pi x) fits any.
"""

from __future__ import annotations

import math

import torch

# Directions of light that change the picture by less than this share of the strongest are left out.
_LEAST = 3e-3
_REWEIGHTINGS = 4


def factored_lights(
    transfer: torch.Tensor, radiance: torch.Tensor, weights: torch.Tensor, groups: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, float, float]:
    """Lights that explain what receivers send, in one color.

    Args:
        transfer: float64 [V, K].
        radiance: float64 [G, V], what each receiver sends under each of G lights.
        weights: float64 [G, V], how well that is known; 0 where it is not.
        groups: int64 [V], receivers that share one albedo.

    Returns:
        Lights [G, K]; the albedo [V], of mean 1 where anything is known and 1 elsewhere; how far this explanation and
        the next best are off the radiance, as shares of it.
    """
    lights, receivers = radiance.shape
    count = transfer.shape[1]
    _, group = groups.unique(return_inverse=True)
    found = errors = scale = albedo = torch.ones(receivers, dtype=torch.float64)
    for _ in range(_REWEIGHTINGS):
        weight = weights * albedo**2
        own = torch.block_diag(*(transfer.T @ (row[:, None] * transfer) for row in weight)) / math.pi**2
        crossed = ((weight * radiance)[:, :, None] * transfer).transpose(0, 1).flatten(1) / math.pi
        zero = torch.zeros(int(group.max()) + 1, dtype=torch.float64)
        crossed = zero.new_zeros(len(zero), lights * count).index_add_(0, group, crossed)
        square = zero.index_add(0, group, (weight * radiance**2).sum(0))
        told = square > 0
        left = own - (crossed[told] / square[told, None]).T @ crossed[told]
        values, vectors = torch.linalg.eigh(own)
        strong = values > _LEAST**2 * values[-1]
        whiten = vectors[:, strong] / values[strong].sqrt()
        errors, directions = torch.linalg.eigh(whiten.T @ left @ whiten)
        found = (whiten @ directions[:, 0]).reshape(lights, count)
        irradiance = found @ transfer.T / math.pi
        if float((weights * irradiance * radiance).sum()) < 0:
            found, irradiance = -found, -irradiance
        above = zero.index_add(0, group, (weights * irradiance * radiance).sum(0))
        below = zero.index_add(0, group, (weights * irradiance**2).sum(0))
        albedo = torch.where(below > 0, above / below.clamp_min(1e-300), 0.0).clamp_min(0)[group]
        known = weights.sum(0) > 0
        scale = albedo[known].mean()
        albedo = torch.where(known | (below > 0)[group], albedo / scale, 1.0)
    best, next_best = (float(value) for value in errors[:2].clamp_min(0).sqrt())
    return found * scale, albedo, best, next_best
