"""Shading of any asset: exit radiance of its receivers under distant light."""

from __future__ import annotations

import torch

from diffprt.compression import ClusteredTransfer, GlossyAsset
from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.shading.diffuse import shade_diffuse
from diffprt.shading.glossy import shade_glossy
from diffprt.transfer import Transfer


def shade(
    asset: Transfer | ClusteredTransfer | GlossyAsset,
    light: Light | torch.Tensor,
    view: torch.Tensor | tuple[float, float, float] | None = None,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """Exit radiance of every receiver: see `shade_diffuse` and `shade_glossy`.

    Args:
        asset: diffuse or glossy transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order.
        view: position of the eye [3], scene units, such as `camera.eye`, or one per receiver [V, 3]; glossy assets
            need it, diffuse ones look the same from everywhere.
        albedo: [V, 3], of diffuse assets only; without it, the receivers' own.

    Returns:
        [V, 3] linear radiance [W/m²/sr]. Gradients reach the asset's signal, light, albedo and view.

    Raises:
        InputError: the light has another order than the asset, a glossy asset without view, or one with albedo.
    """
    if not isinstance(asset, GlossyAsset):
        return shade_diffuse(asset, light, albedo=albedo)
    if view is None:
        raise InputError("a glossy asset looks different from everywhere: give view, such as camera.eye")
    if albedo is not None:
        raise InputError("a glossy asset has its reflectance inside: leave albedo out, or bake with another brdf")
    return shade_glossy(asset, light, view)
