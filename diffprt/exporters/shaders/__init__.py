"""Shaders of every representation in four languages, printed from one source of the arithmetic (`programs/`)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
