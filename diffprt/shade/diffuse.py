"""Diffuse shading: exit radiance of every receiver under distant light."""

from __future__ import annotations

import math

import torch

from diffprt import sh
from diffprt.compress import ClusteredTransfer
from diffprt.errors import InputError
from diffprt.scene import Light
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
    coefficients = light.coefficients if isinstance(light, Light) else light
    if coefficients.shape[0] != asset.order**2:
        raise InputError(
            f"transfer has {asset.order**2} SH coefficients, light has {coefficients.shape[0]}: "
            f"project the light with order={asset.order}, or bake with order={sh.order_of_count(coefficients.shape[0])}"
        )
    albedo = asset.receivers.albedo if albedo is None else albedo
    if isinstance(asset, ClusteredTransfer):
        coefficients = coefficients.to(asset.means.dtype)
        mean_irradiance = _dot(asset.means, coefficients)
        component_irradiance = _dot(asset.bases, coefficients)
        detail = torch.einsum("vp,vpc->vc", asset.weights, component_irradiance[asset.labels])
        irradiance = mean_irradiance[asset.labels] + detail
    else:
        irradiance = _dot(asset.diffuse, coefficients.to(asset.diffuse.dtype))
    return albedo.to(irradiance.dtype) / math.pi * irradiance


def _dot(signal: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Irradiance [..., 3] of a signal [..., C, K] under light [K, 3]; one channel serves all three colours."""
    if signal.shape[-2] == 1:
        return signal[..., 0, :] @ light
    return torch.einsum("...ck,kc->...c", signal, light)
