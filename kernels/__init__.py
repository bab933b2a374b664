"""Warp kernels: visibility, transfer and rasterization. They import no room.

The folder stands at the top of the repository and installs as `diffprt.kernels`; Warp names its compiled
modules after the Python module, so a second import under another name would compile everything twice.
"""

import lazy_loader

if __name__ != "diffprt.kernels":
    raise ImportError("import diffprt.kernels, never the folder 'kernels' itself: pip install -e . first")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
