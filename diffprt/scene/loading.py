"""Mesh files by their ending; every failure is one readable line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl
from trimesh.resolvers import FilePathResolver

from diffprt.errors import InputError
from diffprt.scene.gltf import read_gltf
from diffprt.scene.material import Material
from diffprt.scene.normals import position_groups
from diffprt.scene.obj import read_obj
from diffprt.scene.parts import Part, Parts, linear_colors, texture_from_picture
from diffprt.scene.usd import read_usd


def read_parts(path: Path) -> Parts:
    """Reads a mesh file.

    Raises:
        InputError: the path is missing or a folder, the ending is unknown, the content cannot be read as
            that format, or it holds no triangles.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        raise InputError(f"mesh {path} is a folder: give one file ({', '.join(READERS)})")
    if not path.exists():
        raise InputError(f"mesh {path} does not exist: give the path of a {', '.join(READERS)} file")
    if ending not in READERS:
        raise InputError(f"mesh {path} has ending '{ending}': convert it to one of {', '.join(READERS)}")
    if path.stat().st_size == 0:
        raise InputError(f"mesh {path} has 0 bytes: export it again")
    try:
        result = READERS[ending](path)
    except InputError:
        raise
    except Exception as error:
        # The parsers raise whatever a damaged file makes them stumble on.
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"mesh {path} cannot be read as {ending} ({reason}): export it again") from error
    if not any(len(part.faces) for part in result.parts):
        count = sum(len(part.positions) for part in result.parts)
        raise InputError(f"mesh {path} has {count} vertices and no faces: give a file with triangles")
    result.parts = [
        replace(part, material=result.default_material(part.colors is not None)) if part.material < 0 else part
        for part in result.parts
    ]
    return result


def _read_ply(path: Path) -> Parts:
    """PLY: vertex colours are taken as sRGB, polygons become fans."""
    with path.open("rb") as file:
        loaded = load_ply(file, resolver=FilePathResolver(str(path)), fix_texture=False)
    result = Parts()
    vertices = loaded.get("vertices")
    if vertices is None:
        return result
    faces = loaded.get("faces")
    faces = np.zeros((0, 3), dtype=np.int64) if faces is None else np.asarray(faces, dtype=np.int64)
    if faces.shape[1] == 4:
        # trimesh splits quads only where triangles are among them.
        faces = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    colors = loaded.get("vertex_colors")
    visual = loaded.get("visual")
    uv, material = getattr(visual, "uv", None), -1
    if uv is not None:
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])
        picture = getattr(visual.material, "image", None)
        if picture is not None:
            texture = texture_from_picture(picture)
            material = result.material(Material(1.0, albedo_texture=texture, name=path.stem))
    result.parts.append(
        Part(
            positions=vertices,
            faces=faces,
            normals=loaded.get("vertex_normals"),
            uv=uv,
            colors=None if colors is None else linear_colors(colors),
            material=material,
            name=path.stem,
        )
    )
    return result


def _read_stl(path: Path) -> Parts:
    """STL: corners at exactly the same position become one vertex, in order of first appearance."""
    with path.open("rb") as file:
        loaded = load_stl(file)
    parts = loaded["geometry"].items() if "geometry" in loaded else [(path.stem, loaded)]
    result = Parts()
    for name, solid in parts:
        corners = np.asarray(solid["vertices"], dtype=np.float32)
        groups = position_groups(corners)
        kept = np.unique(groups)
        faces = np.searchsorted(kept, groups)[np.asarray(solid["faces"], dtype=np.int64)]
        result.parts.append(Part(positions=corners[kept], faces=faces, material=-1, name=str(name)))
    return result


READERS = {
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": read_obj,
    ".ply": _read_ply,
    ".stl": _read_stl,
    ".usd": read_usd,
    ".usda": read_usd,
    ".usdc": read_usd,
    ".usdz": read_usd,
}
