"""Exit radiance in the form that varies least over a surface: by mirrored direction, on the scene's axes.

A glossy surface shows the light around the mirror image r = 2 (n·v) n - v of the view v. Between two vertices whose
normals differ by an angle, exit radiance as a function of v turns by twice that angle, and linear interpolation blurs
it, of whole radiance towards the eye and of its coefficients alike. As a function of r it hardly turns at all: without
shadows, the exit radiance of a lobe about r is the light convolved with the lobe, the same at every vertex. So
coefficients by r are what is interpolated, and each pixel finds r with its own normal. At the vertices themselves the
result is exact. The Lambertian part does not depend on direction and is interpolated as ever.

Source: Sloan, Kautz and Snyder, "Precomputed Radiance Transfer for Real-Time Rendering" (SIGGRAPH 2002), which looks
glossy radiance up at the mirrored direction; here that direction only chooses what is interpolated.
"""

from __future__ import annotations

import torch

from diffprt import sh
from diffprt.compression import GlossyAsset
from diffprt.scene import Light
from diffprt.sh.frames import frame_rotations, rows_from_frames
from diffprt.shading.exit_radiance import exit_radiance

_RECEIVERS_AT_ONCE = 8192


def mirrored_radiance(asset: GlossyAsset, light: Light | torch.Tensor) -> torch.Tensor:
    """Exit radiance of every receiver by mirrored direction, in SH on the scene's axes.

    Args:
        asset: glossy transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order.

    Returns:
        [V, 3, K_out] in the asset's dtype; `radiance_towards` evaluates it, at receivers or between them. Gradients
        reach transfer, means, bases, weights and light.

    Raises:
        InputError: the light has another order than the asset.
    """
    # The mirrored direction is the view turned by half a circle about the normal, (-x, -y, z) on the receiver's axes.
    radiance = exit_radiance(asset, light)
    turned = radiance * _half_turn(asset.order_out).to(radiance.dtype)
    parts = []
    for frames, rows in zip(asset.frames.split(_RECEIVERS_AT_ONCE), turned.split(_RECEIVERS_AT_ONCE), strict=True):
        parts.append(rows_from_frames(rows, frame_rotations(frames.to(rows.dtype), asset.order_out)))
    return torch.cat(parts)


def radiance_towards(
    coefficients: torch.Tensor, positions: torch.Tensor, normals: torch.Tensor, eye: torch.Tensor
) -> torch.Tensor:
    """Radiance that points of the surface send towards `eye`.

    Args:
        coefficients: [N, 3, K_out] of `mirrored_radiance`, interpolated to the points.
        positions: [N, 3], scene units.
        normals: [N, 3], interpolated; any length.
        eye: [3], scene units.

    Returns:
        [N, 3] linear radiance [W/m²/sr]. Points that face away send what they send along their horizon. Gradients
        reach all arguments.
    """
    basis = mirrored_basis(positions, normals, eye, sh.order_of_count(coefficients.shape[-1]))
    return torch.einsum("nco,no->nc", coefficients, basis.to(coefficients.dtype))


def mirrored_basis(positions: torch.Tensor, normals: torch.Tensor, eye: torch.Tensor, order: int) -> torch.Tensor:
    """SH [N, K_out] of `order` at the mirrored direction of points that look towards `eye`; see `radiance_towards`."""
    view = torch.nn.functional.normalize(eye - positions, dim=-1)
    normals = torch.nn.functional.normalize(normals, dim=-1)
    below = (view * normals).sum(-1, keepdim=True).clamp_max(0)
    view = torch.nn.functional.normalize(view - below * normals, dim=-1)
    return sh.basis(2 * (view * normals).sum(-1, keepdim=True) * normals - view, order)


def _half_turn(order: int) -> torch.Tensor:
    """(-1)^m of each coefficient, [K]: what a half turn about z multiplies it by."""
    return torch.tensor([(-1.0) ** abs(m) for l in range(order) for m in range(-l, l + 1)])
