"""Glossy pictures: every pixel looks along its own view, with its own normal."""

from __future__ import annotations

import torch

from diffprt.compression import GlossyAsset
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.shading import mirrored_radiance, radiance_towards
from diffprt.surface.view import View

# Pixels whose coefficients are held at a time.
_PIXELS_AT_ONCE = 1 << 14


def glossy_radiance(
    asset: GlossyAsset, light: Light | torch.Tensor, camera: Camera, view: View | None = None
) -> torch.Tensor:
    """Radiance towards the camera at every pixel.

    Coefficients of exit radiance by mirrored direction are interpolated over triangles (`diffprt.shading.mirrored`),
    and each pixel evaluates them with its interpolated normal.

    Args:
        asset: glossy transfer, plain or clustered.
        light: a `Light` or its coefficients [K, 3], of the asset's order.
        camera: where from.
        view: of `camera`, where it is known.

    Returns:
        [H, W, 3] in the asset's dtype; 0 where nothing is seen. Gradients reach transfer, means, bases, weights
        and light.

    Raises:
        InputError: the light has another order, or the asset has no triangles.
    """
    view = View.of(asset.receivers, camera) if view is None else view
    signal = mirrored_radiance(asset, light)
    table, dtype = signal.flatten(1), signal.dtype
    eye = torch.tensor(camera.eye, dtype=torch.float64)
    positions, normals = asset.receivers.positions.double(), asset.receivers.normals.double()
    parts = [signal.new_zeros(0, 3)]
    for corners, weights in zip(
        view.corners[view.mask].split(_PIXELS_AT_ONCE),
        view.barycentrics[view.mask].split(_PIXELS_AT_ONCE),
        strict=True,
    ):
        # A weighted sum of table rows in one step: gathering three rows a pixel first takes twice as long.
        mixed = torch.nn.functional.embedding_bag(corners, table, mode="sum", per_sample_weights=weights.to(dtype))
        share = weights[..., None].double()
        point, normal = ((share * values[corners]).sum(1) for values in (positions, normals))
        parts.append(radiance_towards(mixed.unflatten(1, signal.shape[1:]), point, normal, eye))
    return signal.new_zeros(*view.mask.shape, 3).index_put((view.mask,), torch.cat(parts))
