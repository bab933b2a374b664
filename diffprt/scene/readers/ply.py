"""PLY through trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from trimesh.exchange.ply import load_ply
from trimesh.resolvers import FilePathResolver

from diffprt.scene.material import Material
from diffprt.scene.readers.parts import Part, Parts, linear_colors, texture_from_picture


def read_ply(path: Path) -> Parts:
    """Reads a PLY file: vertex colors are taken as sRGB, polygons become fans."""
    with path.open("rb") as file:
        loaded = load_ply(file, resolver=FilePathResolver(str(path)), fix_texture=False)
    result = Parts()
    vertices = loaded.get("vertices")
    if vertices is None:
        return result
    faces = loaded.get("faces")
    faces = np.zeros((0, 3), dtype=np.int64) if faces is None else np.asarray(faces, dtype=np.int64)
    if faces.ndim == 2 and faces.shape[1] != 3:
        # trimesh splits polygons only where they have different numbers of corners; two corners span nothing.
        fan = [[0, corner, corner + 1] for corner in range(1, faces.shape[1] - 1)]
        faces = faces[:, np.array(fan, dtype=np.int64).reshape(-1)].reshape(-1, 3)
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
