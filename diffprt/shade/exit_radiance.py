"""What leaves every receiver under a light, as a function of direction: T L."""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.transfer import GlossyTransfer


def exit_radiance(asset: GlossyTransfer, light: Light | torch.Tensor) -> torch.Tensor:
    """Exit radiance in SH on each receiver's own axes.

    Args:
        asset: glossy transfer.
        light: a `Light` or its coefficients [K, 3], of the asset's order. To turn it, give `light.rotate(R)`.

    Returns:
        [V, 3, K_out] in the asset's dtype. Gradients reach transfer and light.

    Raises:
        InputError: the light has another order than the asset.
    """
    coefficients = light.coefficients if isinstance(light, Light) else light
    if tuple(coefficients.shape) != (asset.order**2, 3):
        raise InputError(
            f"transfer has {asset.order**2} SH coefficients, light has shape {list(coefficients.shape)}: "
            f"project the light with order={asset.order}"
        )
    coefficients = coefficients.to(asset.glossy.dtype)
    if asset.channels == 1:
        return (asset.glossy[:, 0] @ coefficients).transpose(1, 2)
    return torch.einsum("vcok,kc->vco", asset.glossy, coefficients)
