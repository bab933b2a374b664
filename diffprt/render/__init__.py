"""Rendering: cameras, rasterized views, pictures in linear radiance."""

from diffprt.render.camera import Camera
from diffprt.render.frozen import FrozenView, picture, pixel_radiance
from diffprt.render.glossy import glossy_radiance
from diffprt.render.render import auto_exposure, pixel_rays, render
from diffprt.render.view import View

__all__ = [
    "Camera",
    "FrozenView",
    "View",
    "auto_exposure",
    "glossy_radiance",
    "picture",
    "pixel_radiance",
    "pixel_rays",
    "render",
]
