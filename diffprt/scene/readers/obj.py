"""Wavefront OBJ. trimesh is not used here: it keeps either the order of the vertices or their seams."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diffprt.errors import InputError
from diffprt.file_content import check_content
from diffprt.images import read_image
from diffprt.scene.material import Material
from diffprt.scene.readers.corners import weld
from diffprt.scene.readers.parts import Part, Parts, linear_colors
from diffprt.scene.srgb import linear_from_srgb


def read_obj(path: Path) -> Parts:
    """Reads an OBJ file and its MTL libraries.

    A part per object and material. With one part, vertex i is the i-th `v` line, and a position that is
    used with several uv or normals (a seam) gets further vertices behind the last; with more parts each
    holds the positions that it uses, in the order of the file. Polygons become fans; lines, points and
    free-form surfaces are left out. Smoothing groups are not read: without `vn`, normals are smooth.
    """
    text = path.read_text(encoding="utf-8", errors="strict").replace("\\\n", " ")
    positions, uvs, normals, libraries = [], [], [], []
    group, groups = ("", ""), {}
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            positions.append(rest.split())
        elif word == "f":
            counts = len(positions), len(uvs), len(normals)
            corners = [_corner(token, counts) for token in rest.partition("#")[0].split()]
            fan = groups.setdefault(group, [])
            for i in range(1, len(corners) - 1):
                fan += corners[0], corners[i], corners[i + 1]
        elif word == "vt":
            uvs.append(rest.split()[:2])
        elif word == "vn":
            normals.append(rest.split()[:3])
        elif word == "o":
            group = (rest.strip(), group[1])
        elif word == "usemtl":
            group = (group[0], rest.strip())
        elif word == "mtllib":
            libraries.append(rest.strip())

    result = Parts()
    points = np.array([p[:3] for p in positions], dtype=np.float64).reshape(-1, 3)
    colors = None
    if positions and all(len(p) >= 6 for p in positions):
        colors = linear_colors(np.array([p[3:6] for p in positions], dtype=np.float64))
    uvs = np.array([(t + ["0"])[:2] for t in uvs], dtype=np.float64).reshape(-1, 2)
    normals = np.array(normals, dtype=np.float64).reshape(-1, 3)
    named = _read_libraries(path, libraries, result)
    for (object_name, material_name), fan in groups.items():
        if not fan:
            continue
        corners = np.array(fan, dtype=np.int64)
        _check_range(corners, (len(points), len(uvs), len(normals)), path)
        kept = np.arange(len(points)) if len(groups) == 1 else np.unique(corners[:, 0])
        has_uv, has_normals = (corners[:, 1] >= 0).any(), (corners[:, 2] >= 0).all()
        keys = corners[:, 1:] * np.array([has_uv, has_normals])
        welded = weld(corners[:, 0], keys, kept)
        uv = None
        if has_uv:
            uv = welded.attribute(np.where(corners[:, 1:2] >= 0, uvs[corners[:, 1]], 0))
            uv[:, 1] = 1 - uv[:, 1]
        result.parts.append(
            Part(
                positions=points[welded.vertex],
                faces=welded.faces,
                normals=welded.attribute(normals[corners[:, 2]]) if has_normals else None,
                uv=uv,
                colors=None if colors is None else colors[welded.vertex],
                material=named.get(material_name, -1),
                name=object_name or material_name or path.stem,
            )
        )
    return result


def _corner(token: str, counts: tuple[int, int, int]) -> tuple[int, int, int]:
    """Zero-based (v, vt, vn) of a face corner, -1 where left out; negative numbers count from the last."""
    fields = (token.split("/") + ["", ""])[:3]
    vertex, texture, normal = (
        -1 if not field else (int(field) - 1 if field[0] != "-" else count + int(field))
        for field, count in zip(fields, counts, strict=True)
    )
    return vertex, texture, normal


def _check_range(corners: np.ndarray, counts: tuple[int, int, int], path: Path) -> None:
    low = corners.min(axis=0)
    bad = (corners >= np.array(counts)).sum() + (corners[:, 0] < 0).sum() + (corners[:, 1:] < -1).sum()
    if bad:
        raise InputError(
            f"mesh {path} has {bad} out-of-range indices (v up to {corners[:, 0].max() + 1} of {counts[0]}, "
            f"lowest {low[0] + 1}): repair the file"
        )


def _read_libraries(path: Path, libraries: list[str], result: Parts) -> dict[str, int]:
    """Materials of the MTL files by name; what is missing becomes a remark."""
    named = {}
    for library in libraries:
        file = path.parent / library
        if not file.is_file():
            result.notes.append(f"material library {library} is missing: default materials are used")
            continue
        if file.stat().st_size:
            check_content(file, "material library")
        name, albedo, texture = None, {}, {}
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            word, _, rest = line.strip().partition(" ")
            rest = rest.strip()
            if word == "newmtl":
                name = rest
                albedo.setdefault(name, (1.0, 1.0, 1.0))
            elif word == "Kd" and name is not None:
                try:
                    albedo[name] = tuple(float(x) for x in rest.split()[:3])
                except ValueError:
                    raise InputError(
                        f"material library {file} has Kd '{rest}' of material '{name}': give three numbers"
                    ) from None
            elif word == "map_Kd" and name is not None:
                texture[name] = rest.split()[-1] if rest.startswith("-") else rest
        for name, color in albedo.items():
            picture = file.parent / texture[name].replace("\\", "/") if name in texture else None
            if picture is not None and not picture.is_file():
                result.notes.append(f"texture {texture[name]} of material '{name}' is missing: its Kd is used")
                picture = None
            pixels = None
            if picture is not None:
                pixels = read_image(picture)
                pixels = linear_from_srgb(
                    pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1].expand(-1, -1, 3)
                )
            named[name] = result.material(Material(color, albedo_texture=pixels, name=name))
    return named
