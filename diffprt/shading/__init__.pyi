from .radiance import shade as shade
from .tonemap import CURVES as CURVES
from .tonemap import srgb_encode as srgb_encode
from .tonemap import tone_map as tone_map
