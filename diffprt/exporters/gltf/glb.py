"""Binary glTF that carries the asset: vertices with its data as custom attributes, tables as accessors, and in words
what they mean."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from diffprt.errors import InputError
from diffprt.exporters.packers.packed import Packed, floats
from diffprt.exporters.packers.registry import pack
from diffprt.representation import Representation
from diffprt.representation.files import CONVENTIONS
from diffprt.scene import Light
from diffprt.whole_file import make_folder, write_whole

_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def export_glb(
    asset: Representation, path: str | Path, *, lights: dict[str, Light] | None = None, name: str = "asset"
) -> dict[str, Any]:
    """Writes the asset as one .glb file.

    Vertices carry `_LABEL` (a number) and `_WEIGHTS_0`, `_WEIGHTS_1`, ... (four weights each) beside POSITION, NORMAL
    and, of diffuse assets, the linear albedo, as COLOR_0 for viewers that know nothing of transfer and as `_ALBEDO`.
    Means and bases, or uncompressed transfer, are accessors of single floats that `extras.diffprt` of the mesh names,
    with their shapes, the conventions, the equation of radiance, and lights.

    Args:
        asset: of a kind that `pack` packs with an equation, on receivers with faces.
        path: the file; it is replaced whole.
        lights: of the asset's order, by name; kept in the file.
        name: of the mesh.

    Returns:
        {"path": str, "bytes": int, "kind": str}; `kind` is what the file calls the asset's form.

    Raises:
        InputError: the asset has no faces, no shader or no equation, or the file cannot be written.
    """
    packed = pack(asset)
    if not packed.equation:
        raise InputError(f"'{packed.kind}' has no equation that glTF could carry: give its Packed one")
    if len(packed.geometry["indices"]) == 0:
        raise InputError("asset has no faces to draw: bake a mesh, or give its receivers faces")
    content = _glb(packed, lights or {}, name)
    make_folder(Path(path).parent)
    write_whole(Path(path), content, "file")
    return {"path": str(path), "bytes": len(content), "kind": packed.kind}


class _Buffer:
    """Arrays one after the other, each with its view and accessor."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict] = []
        self.accessors: list[dict] = []

    def add(self, array: np.ndarray, *, target: int | None = None, bounds: bool = False) -> int:
        """The index of an accessor to float32 or uint32 numbers [N] or vectors [N, 3 or 4]."""
        width = array.shape[1] if array.ndim == 2 else 1
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        self.views.append(view | ({} if target is None else {"target": target}))
        accessor = {
            "bufferView": len(self.views) - 1,
            "componentType": _FLOAT if array.dtype == np.float32 else _UNSIGNED_INT,
            "count": len(array),
            "type": _TYPES[width],
        }
        if bounds:
            accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        self.accessors.append(accessor)
        self.data += array.astype(array.dtype.newbyteorder("<")).tobytes()
        return len(self.accessors) - 1


def _glb(packed: Packed, lights: dict[str, Light], name: str) -> bytes:
    buffer = _Buffer()
    attributes = _attributes(packed, buffer)
    indices = buffer.add(packed.geometry["indices"].reshape(-1), target=_ELEMENT_ARRAY_BUFFER)
    tables = {
        key: {"accessor": buffer.add(packed.signal[key].reshape(-1)), "shape": list(packed.signal[key].shape)}
        for key in packed.tables
        if packed.signal[key].size
    }
    weights = sorted((key for key in attributes if key.startswith("_WEIGHTS_")), key=lambda key: int(key[9:]))
    description = {
        "version": 1,
        "kind": packed.kind,
        "conventions": {**CONVENTIONS, **packed.conventions},
        "equation": packed.equation,
        **packed.facts,
        "tables": tables,
        "attributes": {"label": "_LABEL", "weights": weights} if "labels" in packed.signal else {},
        "lights": {key: floats(light.coefficients).tolist() for key, light in lights.items()},
    }
    document = {
        "asset": {"version": "2.0", "generator": "diffprt"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [
            {
                "name": name,
                "primitives": [{"attributes": attributes, "indices": indices, "material": 0}],
                "extras": {"diffprt": description},
            }
        ],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}, "doubleSided": True}],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    chunks = _chunk(b"JSON", text, b" ") + _chunk(b"BIN\0", bytes(buffer.data), b"\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _attributes(packed: Packed, buffer: _Buffer) -> dict[str, int]:
    geometry = packed.geometry
    attributes = {
        "POSITION": buffer.add(geometry["positions"], target=_ARRAY_BUFFER, bounds=True),
        "NORMAL": buffer.add(_unit(geometry["normals"]), target=_ARRAY_BUFFER),
    }
    if "albedo" in geometry:
        albedo = np.broadcast_to(geometry["albedo"], geometry["positions"].shape)
        attributes["COLOR_0"] = buffer.add(albedo, target=_ARRAY_BUFFER)
        attributes["_ALBEDO"] = attributes["COLOR_0"]
    if "labels" in packed.signal:
        attributes["_LABEL"] = buffer.add(packed.signal["labels"].astype(np.float32), target=_ARRAY_BUFFER)
        weights = packed.signal["weights"]
        for first in range(0, weights.shape[1], 4):
            four = np.zeros((len(weights), 4), dtype=np.float32)
            part = weights[:, first : first + 4]
            four[:, : part.shape[1]] = part
            attributes[f"_WEIGHTS_{first // 4}"] = buffer.add(four, target=_ARRAY_BUFFER)
    return attributes


def _unit(normals: np.ndarray) -> np.ndarray:
    """glTF wants unit normals, of vertices without a surface too."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    up = np.array([[0.0, 1.0, 0.0]], dtype=np.float32)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), up).astype(np.float32)


def _chunk(kind: bytes, data: bytes, filler: bytes) -> bytes:
    data += filler * (-len(data) % 4)
    return struct.pack("<I4s", len(data), kind) + data
