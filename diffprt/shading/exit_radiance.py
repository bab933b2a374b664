"""What leaves every receiver under a light, as a function of direction: T L."""

from __future__ import annotations

import torch

from diffprt.compression import ClusteredGlossyTransfer, GlossyAsset
from diffprt.scene import Light
from diffprt.shading.light_product import light_coefficients, under_light


def exit_radiance(asset: GlossyAsset, light: Light | torch.Tensor) -> torch.Tensor:
    """Exit radiance in SH on each receiver's own axes.

    Of a clustered asset it is found as a shader finds it: means and components are applied to the light once for each
    cluster, then blended by the receivers' weights.

    Args:
        asset: glossy transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order. To turn it, give `light.rotate(R)`.

    Returns:
        [V, 3, K_out] in the asset's dtype. Gradients reach transfer, means, bases, weights and light.

    Raises:
        InputError: the light has another order than the asset.
    """
    coefficients = light_coefficients(light, asset.order)
    if isinstance(asset, ClusteredGlossyTransfer):
        return asset.blend(under_light(asset.means, coefficients), under_light(asset.bases, coefficients))
    return under_light(asset.glossy, coefficients)
