"""How bright a picture is shown: the object at mid grey, and the sky behind it below white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from diffprt import sh
from diffprt.rendering.render import auto_exposure, render
from diffprt.representation.interface import Representation
from diffprt.scene.camera import Camera
from diffprt.scene.light import Light
from diffprt.shading import tone_map

_SIDE = 64
# The brightest display value of a sky; 1 is white.
_BRIGHTEST = 0.99
_ROWS = 64


def view_exposure(
    asset: Representation, light: Light | Sequence[Light], camera: Camera, *, curve: str, sky: bool = True
) -> float:
    """The factor on radiance with which `render` and a page show an asset first; one for all of several lights.

    It brings the mean luminance of what `camera` sees of the asset to 0.2 (`auto_exposure`), or less where the
    brightest direction of the light, as it is seen, would come out white under the tone curve.

    Args:
        curve: of `tone_map`.
        sky: whether the light is drawn behind the asset; what is not seen may be as bright as it likes.
    """
    shrink = _SIDE / max(camera.width, camera.height)
    small = replace(camera, width=max(1, round(camera.width * shrink)), height=max(1, round(camera.height * shrink)))
    lights = [light] if isinstance(light, Light) else list(light)
    mask = asset.elements.view(small).mask
    # As one tall picture: an exposure for each would make day of night, and flicker.
    factor = auto_exposure(render(asset, lights, small).flatten(0, 1), mask.repeat(len(lights), 1))
    if not sky:
        return factor
    seen = [sh.render_map(one.seen().coefficients.detach().double(), _ROWS, 2 * _ROWS) for one in lights]
    peak = max(float(sky.max()) for sky in seen)
    return min(factor, white(curve) / peak) if peak > 0 else factor


def clipped_share(image: torch.Tensor, mask: torch.Tensor) -> float:
    """Negative radiance in `image` [H, W, 3] inside `mask`, over the positive: what is lost when it becomes 0."""
    inside = image.detach()[mask].double()
    light, lost = float(inside.clamp_min(0).sum()), float((-inside).clamp_min(0).sum())
    return lost / light if light > 0 else 0.0


def white(curve: str) -> float:
    """The radiance that is shown as `_BRIGHTEST`, by bisection of the tone curve."""
    low, high = 0.0, 1e3
    for _ in range(60):
        middle = (low + high) / 2
        value = float(tone_map(torch.tensor([middle], dtype=torch.float64), curve=curve))
        low, high = (middle, high) if value < _BRIGHTEST else (low, middle)
    return low
