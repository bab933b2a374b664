from diffprt.shade.diffuse import shade
from diffprt.shade.tonemap import CURVES, srgb_encode, tone_map

__all__ = ["CURVES", "shade", "srgb_encode", "tone_map"]
