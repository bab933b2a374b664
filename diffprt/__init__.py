"""diffprt: differentiable precomputed radiance transfer.

Bake how a scene transports light, compress it, shade and render it, export it to a browser; every step is
usable alone and on plain tensors. Conventions are stated in `diffprt.sh`.

Rooms are nouns and functions verbs, so that none hides the other; names are loaded when they are first asked for.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("diffprt")
