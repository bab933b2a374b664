"""Pictures of assets under distant light."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.compression import ClusteredTransfer, GlossyAsset
from diffprt.errors import InputError
from diffprt.rendering.glossy import glossy_radiance
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.shading import shade
from diffprt.surface.view import View
from diffprt.transfer import Transfer

_MID_GREY = 0.2


def render(
    asset: Transfer | ClusteredTransfer | GlossyAsset,
    light: Light,
    camera: Camera | None = None,
    *,
    background: tuple[float, float, float] | str | None = None,
    samples: int = 1,
    threads: int | None = None,
) -> torch.Tensor:
    """A picture in linear radiance; `tone_map` makes display values of it.

    Args:
        asset: what to draw. Diffuse radiance is found per receiver and interpolated linearly over triangles; glossy
            radiance per pixel, see `glossy_radiance`.
        light: distant light of the asset's order.
        camera: without it, one that frames the asset.
        background: linear RGB behind the asset, "light" for the light itself, None for black.
        samples: pixels are the mean of samples x samples.

    Returns:
        [H, W, 3] linear radiance [W/m²/sr]. Gradients reach the asset's signal, the light and the albedo, not
        the silhouettes: visibility is frozen.

    Raises:
        InputError: the light has another order, or the asset has no triangles.
    """
    camera = camera or Camera.framing(asset.receivers.positions)
    if not 1 <= samples <= 16:
        raise InputError(f"samples is {samples}: give 1 to 16 a side")
    fine = replace(camera, width=camera.width * samples, height=camera.height * samples)
    view = View.of(asset.receivers, fine, threads=threads)
    if isinstance(asset, GlossyAsset):
        image = glossy_radiance(asset, light, fine, view)
    else:
        image = view.interpolate(shade(asset, light))
    if background is not None:
        behind = light.radiance(pixel_rays(fine)) if background == "light" else torch.tensor(background)
        image = torch.where(view.mask[..., None], image, behind.to(image.dtype))
    if samples > 1:
        image = image.reshape(camera.height, samples, camera.width, samples, 3).mean(dim=(1, 3))
    return image


def pixel_rays(camera: Camera) -> torch.Tensor:
    """Unit directions float32 [H, W, 3] through the pixel centers, in the scene's axes."""
    rows = 1 - (torch.arange(camera.height, dtype=torch.float64) + 0.5) / camera.height * 2
    columns = (torch.arange(camera.width, dtype=torch.float64) + 0.5) / camera.width * 2 - 1
    projection = camera.projection(1.0, 2.0)
    y, x = torch.meshgrid(rows / projection[1, 1], columns / projection[0, 0], indexing="ij")
    local = torch.stack([x, y, -torch.ones_like(x)], dim=-1)
    return torch.nn.functional.normalize(local @ camera.view()[:3, :3], dim=-1).float()


def auto_exposure(image: torch.Tensor, mask: torch.Tensor) -> float:
    """The exposure that brings the mean luminance (Rec. 709) of `image` [H, W, 3] inside `mask` to 0.2."""
    luminance = image.detach()[mask] @ torch.tensor([0.2126, 0.7152, 0.0722], dtype=image.dtype)
    mean = float(luminance.clamp_min(0).mean()) if len(luminance) else 0.0
    return _MID_GREY / mean if mean > 0 else 1.0
