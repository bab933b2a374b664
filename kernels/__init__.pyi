from .cores import default_threads as default_threads
from .launch import compile_kernels as compile_kernels
from .launch import run_chunks as run_chunks
from .mesh import TriangleMesh as TriangleMesh
