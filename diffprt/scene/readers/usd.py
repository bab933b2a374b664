"""Universal Scene Description through usd-core."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdShade

from diffprt.errors import InputError
from diffprt.file_content import content_of
from diffprt.scene.material import Material
from diffprt.scene.readers.corners import row_numbers, weld
from diffprt.scene.readers.parts import Part, Parts, texture_from_bytes

# The first time sample of what moves, the default value of what does not.
_START = Usd.TimeCode.EarliestTime()


def read_usd(path: Path) -> Parts:
    """Reads the visible polygon meshes of a stage at its start time: a part per mesh and bound material.

    World transforms are applied and the stage's up axis obeyed; metersPerUnit is only reported. Polygons
    become fans, holes are left out, subdivision surfaces are read as their control cage. Face-varying
    values split vertices behind those of the file.
    """
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        reason = str(error).strip().splitlines()[-1].partition(" : ")[2].strip("' ")[:160]
        raise InputError(f"mesh {path} cannot be read as {path.suffix} ({reason}): export it again") from error
    result = Parts(up=str(UsdGeom.GetStageUpAxis(stage)).lower())
    if stage.HasAuthoredMetadata("metersPerUnit"):
        result.notes.append(f"metersPerUnit is {UsdGeom.GetStageMetersPerUnit(stage):g}: positions stay in file units")
    places, materials = UsdGeom.XformCache(_START), {}
    skipped = instancers = 0
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        instancers += prim.IsA(UsdGeom.PointInstancer)
        if not prim.IsA(UsdGeom.Mesh):
            continue
        shown = UsdGeom.Imageable(prim)
        if shown.ComputeVisibility(_START) == "invisible" or shown.ComputePurpose() in ("guide", "proxy"):
            skipped += 1
            continue
        # pxr matrices act on row vectors.
        matrix = np.array(places.GetLocalToWorldTransform(prim), dtype=np.float64).T
        result.parts += [part.placed(matrix) for part in _read_mesh(UsdGeom.Mesh(prim), result, materials)]
    if skipped:
        result.notes.append(f"{skipped} meshes are invisible, guides or proxies: left out")
    if instancers:
        result.notes.append(f"{instancers} point instancers are left out: flatten the stage to include them")
    return result


def _read_mesh(mesh: UsdGeom.Mesh, result: Parts, materials: dict) -> list[Part]:
    name = mesh.GetPrim().GetName()
    points = np.array(mesh.GetPointsAttr().Get(_START) or [], dtype=np.float32).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(_START) or [], dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(_START) or [], dtype=np.int64)
    if counts.sum() != len(indices):
        raise InputError(
            f"mesh '{name}' has {len(indices)} face corners, its counts say {counts.sum()}: repair the file"
        )
    holes = np.array(mesh.GetHoleIndicesAttr().Get(_START) or [], dtype=np.int64)
    if len(holes):
        result.notes.append(f"mesh '{name}' has {len(holes)} faces marked as holes: left out")
    corners, polygon = _fans(counts, holes)
    if mesh.GetOrientationAttr().Get(_START) == "leftHanded":
        corners = corners[:, [0, 2, 1]]
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(points):
        # The shared check counts and refuses these.
        return [Part(points, indices[corners], name=name, material=-1)]

    flat, face = corners.reshape(-1), np.repeat(polygon, 3)
    vertex = indices[flat]
    values = {}
    for key, primvar in _primvars(mesh).items():
        value = _at_corners(*primvar, vertex, flat, face, (len(points), len(indices), len(counts)))
        if value is None:
            result.notes.append(f"mesh '{name}' has {key} of a length that fits no interpolation: left out")
        else:
            values[key] = value

    labels, bound = _bound_materials(mesh, polygon, result, materials)
    parts = []
    for label in np.unique(labels):
        own = np.repeat(labels == label, 3)
        picked = {key: value[own] for key, value in values.items()}
        material = bound[label]
        colors = picked.pop("colors", None)
        if material is not None:
            colors = None
        elif colors is not None and (colors == colors[0]).all():
            material = result.material(Material(tuple(np.clip(colors[0], 0, 1)), name=f"{name} displayColor"))
            colors = None
        if colors is not None:
            picked["colors"] = colors
        numbers = [row_numbers(value, decimals=5) for value in picked.values()]
        keys = np.stack(numbers, axis=1) if numbers else np.zeros((own.sum(), 1), dtype=np.int64)
        used = vertex[own]
        whole = len(np.unique(labels)) == 1
        welded = weld(used, keys, np.arange(len(points)) if whole else np.unique(used))
        made = {key: welded.attribute(value) for key, value in picked.items()}
        if "uv" in made:
            made["uv"][:, 1] = 1 - made["uv"][:, 1]
        material = -1 if material is None else material
        parts.append(Part(points[welded.vertex], welded.faces, name=name, material=material, **made))
    return parts or [Part(points, np.zeros((0, 3), dtype=np.int64), name=name, material=-1)]


def _fans(counts: np.ndarray, holes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners [F, 3] of the triangle fans of all polygons but the holes, and the polygon of each [F]."""
    triangles = np.maximum(counts - 2, 0)
    triangles[holes] = 0
    polygon = np.repeat(np.arange(len(counts)), triangles)
    first = (np.cumsum(counts) - counts)[polygon]
    within = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + within + 1, first + within + 2], axis=1), polygon


def _primvars(mesh: UsdGeom.Mesh) -> dict[str, tuple[np.ndarray, str]]:
    """Normals, uv and colours that the mesh has, each with its interpolation."""
    api = UsdGeom.PrimvarsAPI(mesh)
    found = {}
    normals = api.GetPrimvar("normals")
    if normals.HasValue():
        found["normals"] = (normals.ComputeFlattened(_START), normals.GetInterpolation())
    elif mesh.GetNormalsAttr().HasValue():
        found["normals"] = (mesh.GetNormalsAttr().Get(_START), mesh.GetNormalsInterpolation())
    texture = next((p for p in (api.GetPrimvar(n) for n in ("st", "st0", "UVMap", "uv")) if p.HasValue()), None)
    if texture is not None:
        found["uv"] = (texture.ComputeFlattened(_START), texture.GetInterpolation())
    color = mesh.GetDisplayColorPrimvar()
    if color.HasValue():
        found["colors"] = (color.ComputeFlattened(_START), color.GetInterpolation())
    return {key: (np.array(v, dtype=np.float64), i) for key, (v, i) in found.items() if v is not None and len(v)}


def _at_corners(
    values: np.ndarray,
    interpolation: str,
    vertex: np.ndarray,
    flat: np.ndarray,
    face: np.ndarray,
    sizes: tuple[int, int, int],
) -> np.ndarray | None:
    """Values at each triangle corner, or None when their number fits no reading."""
    points, corners, polygons = sizes
    wanted = {"vertex": points, "varying": points, "faceVarying": corners, "uniform": polygons, "constant": 1}
    index = {
        "vertex": vertex,
        "varying": vertex,
        "faceVarying": flat,
        "uniform": face,
        "constant": np.zeros_like(flat),
    }
    if len(values) != wanted.get(interpolation):
        return None
    return values[index[interpolation]]


def _bound_materials(
    mesh: UsdGeom.Mesh, polygon: np.ndarray, result: Parts, materials: dict
) -> tuple[np.ndarray, list[int | None]]:
    """A label per triangle and the material of each label (None: nothing bound)."""
    labels = np.zeros(len(polygon), dtype=np.int64)
    bound = [_material(mesh.GetPrim(), result, materials)]
    for subset in UsdShade.MaterialBindingAPI(mesh.GetPrim()).GetMaterialBindSubsets():
        members = np.array(subset.GetIndicesAttr().Get(_START) or [], dtype=np.int64)
        labels[np.isin(polygon, members)] = len(bound)
        bound.append(_material(subset.GetPrim(), result, materials))
    return labels, bound


def _material(prim: Usd.Prim, result: Parts, materials: dict) -> int | None:
    """Index of the diffuse colour of the bound UsdPreviewSurface, or None."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not material:
        return None
    path = str(material.GetPath())
    if path not in materials:
        materials[path] = None
        surface = material.ComputeSurfaceSource()[0]
        if surface and surface.GetIdAttr().Get() == "UsdPreviewSurface":
            albedo, texture = _diffuse(surface, result, path)
            made = Material(albedo, albedo_texture=texture, name=material.GetPrim().GetName())
            materials[path] = result.material(made)
        else:
            result.notes.append(f"material {path} is no UsdPreviewSurface: the default is used")
    return materials[path]


def _diffuse(surface: UsdShade.Shader, result: Parts, path: str) -> tuple:
    diffuse = surface.GetInput("diffuseColor")
    if not diffuse:
        return (0.18, 0.18, 0.18), None
    sources = diffuse.GetValueProducingAttributes()
    shader = UsdShade.Shader(sources[0].GetPrim()) if sources else None
    if shader and shader.GetIdAttr().Get() == "UsdUVTexture":
        file = shader.GetInput("file")
        file = file.Get(_START) if file else None
        data = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(file.resolvedPath)) if file else None
        if data:
            return (1.0, 1.0, 1.0), _texture(bytes(data.GetBuffer()), f"texture {file.path} of material {path}")
        result.notes.append(f"texture {file.path if file else ''} of material {path} is missing: grey is used")
        return (0.18, 0.18, 0.18), None
    value = sources[0].Get(_START) if sources else diffuse.Get(_START)
    if value is None or isinstance(value, (Sdf.AssetPath, str)):
        result.notes.append(f"material {path} has a diffuseColor that is not constant or one texture: grey is used")
        return (0.18, 0.18, 0.18), None
    return tuple(float(np.clip(x, 0, 1)) for x in value), None


def _texture(data: bytes, named: str) -> torch.Tensor:
    """The texture in the bytes of a picture."""
    try:
        return texture_from_bytes(data)
    except (OSError, ValueError, SyntaxError) as error:
        found = content_of(data)
        reason = str(error) if found is None or found.endings else found.name
        raise InputError(f"{named} is no picture that can be read ({reason}): give a PNG or a JPEG") from error
