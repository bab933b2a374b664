"""glTF 2.0 and GLB: trimesh decodes the accessors; factors and colours are read here at full precision."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import torch
from PIL import Image
from trimesh.exchange.gltf import load_glb, load_gltf
from trimesh.resolvers import FilePathResolver

from diffprt.errors import InputError
from diffprt.scene.material import Material
from diffprt.scene.readers.gltf_files import check_buffers, texture_of
from diffprt.scene.readers.parts import Part, Parts, texture_from_picture

# Primitive modes that trimesh reads: points, lines, triangles, strips.
_MODES_READ = (0, 1, 4, 5)


def read_gltf(path: Path) -> Parts:
    """Reads a .gltf or .glb file: a part per node and primitive, in the order of the file's meshes.

    Node transforms are applied; baseColorFactor (linear), baseColorTexture (sRGB) and COLOR_0 (linear)
    make the albedo; KHR_materials_diffuse_transmission makes surfaces translucent, by its factor, in the color of the
    albedo. Skins, morph targets and texture transforms are left out.
    """
    header = _header(path)
    check_buffers(path, header)
    with path.open("rb") as file:
        loader = load_glb if path.suffix.lower() == ".glb" else load_gltf
        loaded = loader(file, resolver=_Beside(str(path)))
    primitives = [p for m in header.get("meshes", []) for p in m["primitives"] if p.get("mode", 4) in _MODES_READ]
    geometry = loaded["geometry"]
    order = {name: index for index, name in enumerate(geometry)}

    result = Parts()
    index_of, pictures = {}, {}
    for name, primitive in zip(geometry, primitives, strict=True):
        visual = geometry[name].get("visual")
        picture = getattr(getattr(visual, "material", None), "baseColorTexture", None)
        if picture is not None:
            pictures.setdefault(primitive.get("material"), picture)
    used = {primitive.get("material") for primitive in primitives}
    for index, described in enumerate(header.get("materials", [])):
        factor = described.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1.0, 1.0, 1.0])[:3]
        texture = None
        if index in used and (named := texture_of(path, header, described, result.notes)) is not None:
            if index in pictures:
                texture = _texture(pictures[index], named)
            else:
                result.notes.append(f"{named} cannot be read: its factor is used")
        through = described.get("extensions", {}).get("KHR_materials_diffuse_transmission", {})
        if "diffuseTransmissionTexture" in through or "diffuseTransmissionColorTexture" in through:
            result.notes.append(f"material {index} has textures of diffuse transmission: left out")
        material = Material(
            tuple(factor),
            albedo_texture=texture,
            name=described.get("name", f"material {index}"),
            transmission=through.get("diffuseTransmissionFactor", 0.0),
        )
        index_of[index] = result.material(material)

    world = {loaded["base_frame"]: np.eye(4)}
    placed = []
    for edge in loaded["graph"]:
        world[edge["frame_to"]] = world[edge["frame_from"]] @ np.asarray(edge["matrix"], dtype=np.float64)
        name = edge.get("geometry")
        if name is not None and "faces" in geometry[name]:
            placed.append((order[name], len(placed), name, world[edge["frame_to"]]))
    # trimesh walks the last node first.
    for position, _, name, matrix in sorted(placed, key=lambda item: (item[0], -item[1])):
        part = _part(geometry[name], index_of.get(primitives[position].get("material"), -1), name)
        result.parts.append(part.placed(matrix))
    skipped = sum(p.get("mode", 4) not in (4, 5) for m in header.get("meshes", []) for p in m["primitives"])
    if skipped:
        result.notes.append(f"{skipped} primitives are not triangles: left out")
    if header.get("skins"):
        result.notes.append("skins are left out: meshes are in their bind pose")
    return result


class _Beside(FilePathResolver):
    """Files beside the glTF file, whose names are percent-encoded in it."""

    def get(self, name: str) -> bytes:
        return super().get(unquote(name))


def _texture(picture: Image.Image, named: str) -> torch.Tensor:
    """A decoded texture; it is decoded only now."""
    try:
        return texture_from_picture(picture)
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{named} is damaged ({error}): export it again") from error


def _part(loaded: dict, material: int, name: str) -> Part:
    visual = loaded.get("visual")
    uv = getattr(visual, "uv", None)
    if uv is not None:
        # trimesh turned v to point up.
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])
    colors = loaded.get("vertex_colors")
    if colors is None and visual is not None:
        colors = visual.vertex_attributes.get("color")
    if colors is not None:
        colors = np.asarray(colors)[:, :3]
        if np.issubdtype(colors.dtype, np.integer):
            colors = colors / np.iinfo(colors.dtype).max
    return Part(
        positions=np.asarray(loaded["vertices"]),
        faces=np.asarray(loaded["faces"], dtype=np.int64),
        normals=loaded.get("vertex_normals"),
        uv=uv,
        colors=colors,
        material=material,
        name=name,
    )


def _header(path: Path) -> dict:
    """The JSON of the file; trimesh rounds the factors in it to 8 bits."""
    data = path.read_bytes()
    if path.suffix.lower() == ".glb":
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    return json.loads(data.decode("utf-8"))
