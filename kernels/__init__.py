"""Warp kernels: visibility, transfer and rasterization. They import no room.

The folder stands at the top of the repository and installs as `diffprt.kernels`; Warp names its compiled
modules after the Python module, so a second import under another name would compile everything twice.
"""

if __name__ != "diffprt.kernels":
    raise ImportError("import diffprt.kernels, never the folder 'kernels' itself: pip install -e . first")

from diffprt.kernels.launch import compile_kernels, default_threads, run_chunks
from diffprt.kernels.mesh import TriangleMesh

__all__ = ["TriangleMesh", "compile_kernels", "default_threads", "run_chunks"]
