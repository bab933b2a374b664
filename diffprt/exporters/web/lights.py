"""The lights of a page: the one it has when none is given, and any, made as bright as pictures want it."""

from __future__ import annotations

import math
from functools import lru_cache

import torch

from diffprt import sh
from diffprt.options import ExportOptions
from diffprt.rendering import view_exposure
from diffprt.representation import Representation
from diffprt.scene import Camera, Light

_SKY_RADIANCE = (0.30, 0.36, 0.44)
_SUN_IRRADIANCE = (2.6, 2.2, 1.7)
_SUN_DIRECTION = (0.45, 0.75, 0.5)


@lru_cache(maxsize=10)
def default_light(order: int) -> Light:
    """A uniform sky and one sun from the upper right, windowed so that the bands of `order` do not ring."""
    sun = torch.nn.functional.normalize(torch.tensor(_SUN_DIRECTION, dtype=torch.float64), dim=0)
    coefficients = sh.basis(sun, order)[:, None] * torch.tensor(_SUN_IRRADIANCE, dtype=torch.float64)
    coefficients[0] += math.sqrt(4 * math.pi) * torch.tensor(_SKY_RADIANCE, dtype=torch.float64)
    windowed, _ = sh.apply_window(coefficients, "auto")
    return Light(windowed.float())


def balanced_light(
    asset: Representation, light: Light, camera: Camera | None = None, *, curve: str = ExportOptions.curve
) -> Light:
    """The light scaled so that the asset is well exposed at exposure 1, as `render` does it: maps come in any unit."""
    factor = view_exposure(asset, light, camera or Camera.framing(asset.elements.subject), curve=curve)
    return Light(light.coefficients * factor, light.report)
