"""Diffuse shading: exit radiance of every receiver under distant light."""

from __future__ import annotations

import math

import torch

from diffprt.compression import ClusteredTransfer
from diffprt.scene import Light
from diffprt.shading.light_product import light_coefficients, under_light
from diffprt.transfer import Transfer


def shade_diffuse(
    asset: Transfer | ClusteredTransfer,
    light: Light | torch.Tensor,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """Exit radiance of every receiver: albedo / pi times transfer dot light.

    A clustered asset is shaded as the shader does it: means and components are dotted with the light first,
    then blended by the receivers' weights.

    Args:
        asset: diffuse transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order.
        albedo: [V, 3]; without it, the receivers' own.

    Returns:
        [V, 3] linear radiance [W/m²/sr]. Gradients reach transfer, means, bases, weights, light and albedo.

    Raises:
        InputError: the light has another order than the asset.
    """
    coefficients = light_coefficients(light, asset.order)
    albedo = asset.receivers.albedo if albedo is None else albedo
    if isinstance(asset, ClusteredTransfer):
        irradiance = asset.blend(_irradiance(asset.means, coefficients), _irradiance(asset.bases, coefficients))
    else:
        irradiance = _irradiance(asset.diffuse, coefficients)
    return albedo.to(irradiance.dtype) / math.pi * irradiance


def _irradiance(signal: torch.Tensor, coefficients: torch.Tensor) -> torch.Tensor:
    """[..., 3] of a signal [..., C, K]: the same to every direction, so K_out is 1."""
    return under_light(signal[..., None, :], coefficients)[..., 0]
