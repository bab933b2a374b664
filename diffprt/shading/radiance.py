"""Shading: what an asset's elements send out under lights."""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.representation.interface import Representation
from diffprt.representation.lighting import LightsLike, each_of


def shade(
    asset: Representation,
    light: LightsLike,
    view: torch.Tensor | tuple[float, float, float] | None = None,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """Exit radiance of every element; of clustered transfer as a shader finds it, clusters first.

    Args:
        asset: any representation, plain or compressed.
        light: a `Light` or its coefficients [K, 3], of the asset's order; or whatever `Lighting` the kind answers to. A
            batch of B lights is coefficients [B, K, 3] or a list, of `Light` say, and costs less than one by one.
        view: position of the eye [3], scene units, such as `camera.eye`, or one per element [E, 3]; glossy assets need
            it, diffuse ones look the same from everywhere.
        albedo: [E, 3], of assets that leave it out of their signal; without it, the elements' own.

    Returns:
        [E, 3] linear radiance [W/m²/sr] in the dtype of the signal, [B, E, 3] of a batch. Elements that face away from
        the eye get what they send along their horizon. Gradients reach the asset's signal, light, albedo and view.

    Raises:
        InputError: light of another order or kind, an eye of another shape, a glossy asset without one, or one with
            albedo.
    """
    dtype, count = asset.elements.positions.dtype, len(asset.elements)
    eye = None if view is None else torch.as_tensor(view, dtype=dtype, device=asset.elements.positions.device)
    if eye is not None and tuple(eye.shape) not in {(3,), (count, 3)}:
        raise InputError(f"eye has shape {list(eye.shape)}: give one position [3], or one per element [{count}, 3]")
    each, batch = each_of(light)
    return asset.radiance_each(each, eye, albedo=albedo) if batch else asset.radiance(each[0], eye, albedo=albedo)
