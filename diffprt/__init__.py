"""diffprt: differentiable precomputed radiance transfer.

Bake how a scene transports light, compress it, shade and render it, export it to a browser; every step is
usable alone and on plain tensors. Conventions are stated in `diffprt.sh`.
"""

from importlib.metadata import version

from diffprt.asset import load, save
from diffprt.compress import ClusteredGlossyTransfer, ClusteredTransfer, compress
from diffprt.errors import InputError
from diffprt.export import export, show
from diffprt.optimize import References, load_references, make_references, optimize, save_references
from diffprt.render import Camera, render
from diffprt.scene import Environment, Light, Scene
from diffprt.shade import shade, tone_map
from diffprt.transfer import Receivers, Transfer, bake, trace

__version__ = version("diffprt")

__all__ = [
    "Camera",
    "ClusteredGlossyTransfer",
    "ClusteredTransfer",
    "Environment",
    "InputError",
    "Light",
    "Receivers",
    "References",
    "Scene",
    "Transfer",
    "bake",
    "compress",
    "export",
    "load",
    "load_references",
    "make_references",
    "optimize",
    "render",
    "save",
    "save_references",
    "shade",
    "show",
    "tone_map",
    "trace",
]
