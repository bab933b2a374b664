"""Glossy shading: exit radiance of every receiver towards a camera, under distant light."""

from __future__ import annotations

import torch

from diffprt import sh
from diffprt.compression import GlossyAsset
from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.shading.exit_radiance import exit_radiance
from diffprt.transfer.glossy.bounce import above_horizon


def shade_glossy(asset: GlossyAsset, light: Light | torch.Tensor, eye: torch.Tensor | tuple) -> torch.Tensor:
    """Exit radiance towards a point: y(view)ᵀ T L. To turn the light, give `light.rotate(R)`.

    Args:
        asset: glossy transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order.
        eye: camera position [3], scene units; or one per receiver [V, 3].

    Returns:
        [V, 3] linear radiance [W/m²/sr] in the asset's dtype. Receivers that face away from the eye get what they
        send along their horizon. Gradients reach transfer, means, bases, weights, light and eye.

    Raises:
        InputError: the light has another order than the asset, or the eye another shape.
    """
    radiance = exit_radiance(asset, light)
    exit_basis = sh.basis(view_directions(asset, eye), asset.order_out).to(radiance.dtype)
    return torch.einsum("vco,vo->vc", radiance, exit_basis)


def view_directions(asset: GlossyAsset, eye: torch.Tensor | tuple) -> torch.Tensor:
    """Unit directions [V, 3] towards `eye` on each receiver's own axes, lifted to the horizon where they are below.

    Raises:
        InputError: `eye` neither [3] nor [V, 3].
    """
    positions = asset.receivers.positions
    eye = torch.as_tensor(eye, dtype=positions.dtype)
    if tuple(eye.shape) not in {(3,), tuple(positions.shape)}:
        raise InputError(f"eye has shape {list(eye.shape)}: give one position [3], or one per receiver [V, 3]")
    outward = torch.nn.functional.normalize(eye - positions, dim=-1)
    return above_horizon(torch.einsum("vij,vi->vj", asset.frames, outward))
