"""From a baked asset to files that run elsewhere: a web page, binary glTF, shaders, a module for three.js.

`export` writes a self-contained HTML file that relights the asset, `show` shows it in a notebook, `export_glb` writes
the asset as binary glTF, `write_shaders` its shaders in four languages (`diffprt.export.shading`), `write_three` a
module that draws the glTF in three.js, and `to_engine` gives a light as other engines store it.
"""

from diffprt.export.conventions import ENGINES, from_engine, to_engine
from diffprt.export.gltf import export_glb
from diffprt.export.notebook import show
from diffprt.export.page_file import export
from diffprt.export.representations import Packed, pack
from diffprt.export.shading import shader_source, write_shaders
from diffprt.export.three_module import write_three

__all__ = [
    "ENGINES",
    "Packed",
    "export",
    "export_glb",
    "from_engine",
    "pack",
    "shader_source",
    "show",
    "to_engine",
    "write_shaders",
    "write_three",
]
