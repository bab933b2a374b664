from .exit_radiance import exit_radiance as exit_radiance
from .mirrored import mirrored_basis as mirrored_basis
from .mirrored import mirrored_radiance as mirrored_radiance
from .mirrored import radiance_towards as radiance_towards
from .shade import shade as shade
from .tonemap import CURVES as CURVES
from .tonemap import srgb_encode as srgb_encode
from .tonemap import tone_map as tone_map
