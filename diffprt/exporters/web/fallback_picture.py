"""A small picture of the asset, for browsers that cannot draw it."""

from __future__ import annotations

import base64
import io
from dataclasses import replace

import numpy as np
import torch
from PIL import Image

from diffprt.rendering import render
from diffprt.representation import Representation
from diffprt.scene import Camera, Light
from diffprt.shading import tone_map

_WIDTH, _HEIGHT = 256, 192
_QUALITY = 80


def fallback_picture(asset: Representation, light: Light, camera: Camera, *, exposure: float, curve: str) -> str:
    """A JPEG as a data URL: the first view under the first light, before a dark backdrop."""
    view = replace(camera, width=_WIDTH, height=_HEIGHT)
    with torch.no_grad():
        # Assets in training and in double precision give the same bytes as they do when saved.
        single = asset.to(torch.float32)
        radiance = render(single, light, view, background=(0.012, 0.013, 0.016))
        shown = tone_map(radiance, exposure=exposure, curve=curve).clamp(0, 1)
    pixels = Image.fromarray(np.rint(shown.numpy() * 255).astype(np.uint8))
    stored = io.BytesIO()
    pixels.save(stored, "JPEG", quality=_QUALITY, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(stored.getvalue()).decode("ascii")
