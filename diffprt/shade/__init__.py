"""Shading: exit radiance of receivers under distant light, and tone curves."""

from diffprt.shade.exit_radiance import exit_radiance
from diffprt.shade.mirrored import mirrored_basis, mirrored_radiance, radiance_towards
from diffprt.shade.shade import shade
from diffprt.shade.tonemap import CURVES, srgb_encode, tone_map

__all__ = [
    "CURVES",
    "exit_radiance",
    "mirrored_basis",
    "mirrored_radiance",
    "radiance_towards",
    "shade",
    "srgb_encode",
    "tone_map",
]
