"""Scenes and lights: what is loaded, checked and described before anything is simulated.

Right-handed, +y up, linear RGB. Files: .glb .gltf .obj .ply .stl .usd .usda .usdc .usdz for scenes; .hdr .exr
.png for environments. "builtin:NAME" stands for a scene or environment that needs no file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
