"""A diffprt scene, its light and its camera as Mitsuba 3 knows them, and pictures path-traced from them.

Mitsuba is an optional peer (`pip install "diffprt[study]"`). What differs between the two and is converted:

- **Map.** Mitsuba's environment map has +y at its top like ours, but its left border looks along -z, which is
  our center column; both run towards +x. Its columns are centered like ours, its rows lie on the poles: row j
  of H is at polar angle π j / (H - 1), not π (j + 0.5) / H. Both were read off the emitter, evaluated on
  ramps over rows and over columns (Mitsuba 3.9.1); a test compares the emitter with the light itself.
- **Camera.** Mitsuba's camera looks along its own +z with +x to the left; `look_at` and the film undo each
  other, and pictures come out as ours. `fov_axis` "y" makes its field of view vertical.
- **Surfaces.** One-sided `diffuse` reflects in front and is black behind, and blocks on both sides, as ours.
  Occluder-only meshes get the albedo 0, because `bake` lets them absorb.
- **BRDFs.** Glossy surfaces have one BSDF for each BRDF (`mitsuba_bsdf`), without textures, as in `bake_glossy`.
- **Depth.** `bounces` interreflections are paths of `bounces + 2` segments: one to the eye, one to the light.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from types import ModuleType

import numpy as np
import torch

from diffprt import sh
from diffprt.brdf import Brdf
from diffprt.errors import InputError
from diffprt.scene import Camera, Light, Mesh, Scene
from diffprt.study.mitsuba.bsdf import mitsuba_bsdf

# Rows of the map: its bilinear error is below 2e-4 of a function of order 6.
_MAP_ROWS = 512
# Paths in flight at once, which bounds the memory of the vectorized variant.
_WAVEFRONT = 1 << 22
_PROBE = "import mitsuba as m; m.set_variant('llvm_ad_rgb'); m.render(m.load_dict(m.cornell_box()), spp=1).numpy()"


def start_mitsuba() -> tuple[ModuleType, str]:
    """Mitsuba with the fastest CPU variant that works, and a note on what was not found (or "").

    LLVM is tried in another process first: a version that Mitsuba does not get along with ends the process.

    Raises:
        InputError: Mitsuba is not installed.
    """
    if find_spec("mitsuba") is None:
        raise InputError('this study compares with Mitsuba, which is not installed: pip install "diffprt[study]"')
    import mitsuba

    if mitsuba.variant() is not None:
        return mitsuba, ""
    probe = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True)
    if probe.returncode == 0:
        mitsuba.set_variant("llvm_ad_rgb")
        return mitsuba, ""
    mitsuba.set_variant("scalar_rgb")
    return mitsuba, (
        "LLVM was not found or failed, so Mitsuba runs its slower scalar variant: "
        "install LLVM 16 or newer, or name it in DRJIT_LIBLLVM_PATH"
    )


def mitsuba_map(light: Light, rows: int = _MAP_ROWS) -> torch.Tensor:
    """The band-limited light as Mitsuba's environment map, float32 [rows, 2 rows, 3] in radiance.

    Raises:
        InputError: the light is negative somewhere, which no path tracer can sample.
    """
    directions = mitsuba_directions(rows)
    radiance = sh.evaluate(light.coefficients.detach().double(), directions)
    lowest, highest = float(radiance.min()), float(radiance.max())
    # Coefficients are rounded to float32, so a light that touches zero may cross it by as much.
    if lowest < -1e-5 * highest:
        raise InputError(f"the light is negative, {lowest:.3g} of {highest:.3g}: project it with window='auto'")
    return radiance.clamp_min(0).float()


def mitsuba_directions(rows: int) -> torch.Tensor:
    """Where the texels of Mitsuba's map look, unit, float64 [rows, 2 rows, 3]."""
    columns = 2 * rows
    polar = torch.pi * torch.arange(rows, dtype=torch.float64)[:, None] / (rows - 1)
    longitude = 2 * torch.pi * (torch.arange(columns, dtype=torch.float64) + 0.5) / columns
    sine = polar.sin()
    return torch.stack([sine * longitude.sin(), polar.cos().expand(-1, columns), -sine * longitude.cos()], dim=-1)


def mitsuba_scene(mitsuba: ModuleType, scene: Scene, light: Light, camera: Camera, brdf: Sequence[Brdf] = ()) -> object:
    """Same triangles, normals, albedo or BRDFs, light and camera as a Mitsuba scene (float32 in both).

    Args:
        brdf: one for all surfaces or one per material, in place of albedo; none where surfaces are Lambertian.

    Raises:
        InputError: the light is negative somewhere, or Mitsuba has no such BSDF.
    """
    bounds = scene.bounds.double()
    reach = float((bounds - torch.tensor(camera.eye, dtype=torch.float64)).abs().sum(1).max())
    described = {
        "type": "scene",
        "light": {"type": "envmap", "bitmap": mitsuba.Bitmap(mitsuba_map(light).numpy())},
        "camera": {
            "type": "perspective",
            "fov": camera.fov,
            "fov_axis": "y",
            "near_clip": 1e-4 * reach,
            "far_clip": 10 * reach,
            "to_world": mitsuba.ScalarTransform4f().look_at(list(camera.eye), list(camera.target), list(camera.up)),
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "pixel_format": "rgba",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }
    for index, mesh in enumerate(scene.meshes):
        albedo = mesh.vertex_albedo(scene.materials).detach()
        albedo = torch.zeros_like(albedo) if mesh.occluder_only else albedo
        surface = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_albedo"}}
        if len(brdf) and not mesh.occluder_only:
            surface = mitsuba_bsdf(mitsuba, brdf[mesh.material if len(brdf) > 1 else 0])
        described[f"mesh{index}"] = _mesh(mitsuba, mesh, surface, albedo)
    return mitsuba.load_dict(described)


def path_trace(mitsuba: ModuleType, scene: object, *, bounces: int, samples: int, seed: int) -> torch.Tensor:
    """Radiance and coverage, float64 [H, W, 4], the mean of `samples` independent paths a pixel.

    Pictures of the same `samples` and different `seed` (0, 1, ...) are independent. Russian roulette is off,
    so that only the paths' directions are random.
    """
    integrator = mitsuba.load_dict(
        {"type": "path", "max_depth": bounces + 2, "rr_depth": bounces + 3, "hide_emitters": True}
    )
    width, height = (int(side) for side in scene.sensors()[0].film().size())
    portion = max(1, min(samples, _WAVEFRONT // (height * width)))
    passes = -(-samples // portion)
    total = torch.zeros(height, width, 4, dtype=torch.float64)
    for index in range(passes):
        count = min(portion, samples - index * portion)
        # Small consecutive seeds: the scalar variant multiplies them by the number of pixels in 32 bits, so
        # seeds that differ by a large power of two give the same picture.
        picture = mitsuba.render(scene, integrator=integrator, spp=count, seed=seed * passes + index)
        total += count * torch.from_numpy(np.array(picture, dtype=np.float64))
    return total / samples


def _mesh(mitsuba: ModuleType, mesh: Mesh, surface: dict, albedo: torch.Tensor) -> object:
    """One mesh with a BSDF, and with an albedo [V, 3] that varies linearly over triangles."""
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(surface)
    built = mitsuba.Mesh(mesh.name, len(mesh.positions), len(mesh.faces), props=properties, has_vertex_normals=True)
    built.add_attribute("vertex_albedo", 3, albedo.float().reshape(-1).numpy())
    values = mitsuba.traverse(built)
    values["vertex_positions"] = mesh.positions.reshape(-1).numpy()
    values["vertex_normals"] = mesh.normals.reshape(-1).numpy()
    values["faces"] = mesh.faces.to(torch.int32).reshape(-1).numpy().astype(np.uint32)
    values.update()
    return built
