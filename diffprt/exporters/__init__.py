"""From a baked asset to files that run elsewhere: a web page, binary glTF, shaders, a module for three.js.

`export` writes a self-contained HTML file that relights the asset, `show` shows it in a notebook, `export_glb` writes
the asset as binary glTF, `write_shaders` its shaders in four languages (`diffprt.exporters.shaders`), `write_three` a
module that draws the glTF in three.js, and `to_engine` gives a light as other engines store it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
