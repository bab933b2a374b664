"""Options of every operation, each listed once: for Python, for the command line and for what assets record.

Light on purpose: reading an option's name, default or help loads neither torch nor NumPy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
