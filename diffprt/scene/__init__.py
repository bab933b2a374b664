"""Scenes and lights: what is loaded, checked and described before anything is simulated.

Right-handed, +y up, linear RGB. Files: .glb .gltf .obj .ply .stl .usd .usda .usdc .usdz for scenes; .hdr .exr
.png for environments. "builtin:NAME" stands for a scene or environment that needs no file.
"""

from diffprt.scene.builtin import BUILTIN_SCENES
from diffprt.scene.checks import POLICY, DefectReport
from diffprt.scene.environment import Environment
from diffprt.scene.geometry import Geometry
from diffprt.scene.light import Light
from diffprt.scene.light_shapes import area_light, constant_light, directional_light, disc_light, sphere_light
from diffprt.scene.loading import READERS
from diffprt.scene.material import BRDFS, Material
from diffprt.scene.mesh import Mesh
from diffprt.scene.procedural import (
    BUILTIN_ENVIRONMENTS,
    builtin_environment,
    load_environment,
    sky_environment,
    studio_environment,
)
from diffprt.scene.scene import Scene, builtin_scene, load_scene

__all__ = [
    "BRDFS",
    "BUILTIN_ENVIRONMENTS",
    "BUILTIN_SCENES",
    "POLICY",
    "READERS",
    "DefectReport",
    "Environment",
    "Geometry",
    "Light",
    "Material",
    "Mesh",
    "Scene",
    "area_light",
    "builtin_environment",
    "builtin_scene",
    "constant_light",
    "directional_light",
    "disc_light",
    "load_environment",
    "load_scene",
    "sky_environment",
    "sphere_light",
    "studio_environment",
]
