"""BRDFs: evaluated, sampled, and as matrices between spherical harmonics. In the local frame, z is the normal."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
