"""Pictures of assets under distant light."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.errors import InputError
from diffprt.rendering.memory import check_picture
from diffprt.representation.interface import Representation
from diffprt.representation.lighting import Lighting, LightingLike, LightsLike, each_of
from diffprt.representation.lit import Lit
from diffprt.representation.view import View
from diffprt.scene.camera import Camera
from diffprt.scene.light import Light

_MID_GREY = 0.2
# Samples whose coefficients are held at a time.
_SAMPLES_AT_ONCE = 1 << 14
# Lights whose pictures are held before pixels are means of their samples.
_LIGHTS_AT_ONCE = 8


def render(
    asset: Representation,
    light: LightsLike,
    camera: Camera | None = None,
    *,
    background: tuple[float, float, float] | str | None = None,
    samples: int = 1,
    threads: int | None = None,
) -> torch.Tensor:
    """A picture in linear radiance; `tone_map` makes display values of it.

    Args:
        asset: what to draw. Coefficients of its elements are weighted as each sample sees them (interpolated linearly
            over triangles, say), and read in its basis: diffuse radiance as it is, glossy radiance with the pixel's own
            normal and view, by mirrored direction.
        light: distant light of the asset's order, or what its kind answers to. A batch of B lights is coefficients
            [B, K, 3] or a list, of `Light` say: what the camera sees is found once for all of them.
        camera: without it, one that frames the asset, not the ground under it.
        background: linear RGB behind the asset, "light" for the distant light as it is seen (`Light.seen`),
            None for black.
        samples: pixels are the mean of samples x samples.

    Returns:
        [H, W, 3] linear radiance [W/m²/sr], [B, H, W, 3] of a batch. Gradients reach the asset's signal, the light and
        the albedo, not the silhouettes: visibility is frozen.

    Raises:
        InputError: light of another order or kind, or an asset that cannot be drawn, such as one without triangles.
    """
    camera = camera or Camera.framing(asset.elements.subject)
    if not 1 <= samples <= 16:
        raise InputError(f"samples is {samples}: give 1 to 16 a side")
    check_picture(camera, samples)
    fine = replace(camera, width=camera.width * samples, height=camera.height * samples)
    each, batch = each_of(light)
    rays = pixel_rays(fine) if background == "light" else None
    behind = [_background(background, one, rays) for one in each]
    view = asset.elements.view(fine, threads=threads)
    lit = asset.lit_each(each) if batch else asset.lit(each[0])
    pictures = []
    for first in range(0, len(each), _LIGHTS_AT_ONCE):
        last = min(first + _LIGHTS_AT_ONCE, len(each))
        some = Lit(lit.coefficients[:, 3 * first : 3 * last], lit.basis)
        image = view.framed(radiance_in_view(some, view, fine))
        if background is not None:
            image = torch.where(view.mask[..., None], image, torch.cat(behind[first:last], dim=-1).to(image))
        if samples > 1:
            image = image.reshape(camera.height, samples, camera.width, samples, -1).mean(dim=(1, 3))
        pictures += image.split(3, dim=-1)
    return torch.stack(pictures) if batch else pictures[0]


def radiance_in_view(lit: Lit, view: View, camera: Camera) -> torch.Tensor:
    """Radiance of the samples of `view` towards the camera, [N, 3] or [N, 3 B] under B lights; gradients reach the
    coefficients."""
    eye = torch.tensor(camera.eye, dtype=torch.float64)
    rows = range(0, len(view.index), _SAMPLES_AT_ONCE)
    parts = [lit.towards(view.samples(slice(first, first + _SAMPLES_AT_ONCE)), eye) for first in rows]
    return torch.cat([lit.coefficients.new_zeros(0, lit.coefficients.shape[1]), *parts])


def _background(
    background: tuple[float, float, float] | str | None, light: LightingLike, rays: torch.Tensor | None
) -> torch.Tensor:
    """What stands behind the asset: a color [3], or the distant light along `rays`, [H, W, 3]."""
    if rays is not None:
        return _distant(light).seen().radiance(rays)
    color = torch.as_tensor(0.0 if background is None else background)
    return color.expand(*color.shape[:-1], 3)


def _distant(light: LightingLike) -> Light:
    """The distant part of a lighting; raises InputError where there is none to be seen."""
    distant = Lighting.of(light).distant
    if distant is None:
        raise InputError("background is 'light' and there is no distant light: give a color")
    return distant if isinstance(distant, Light) else Light(distant)


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
