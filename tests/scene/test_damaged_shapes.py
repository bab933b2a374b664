"""Mesh files whose arrays do not belong together are refused in one line; polygons of any size are taken."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from diffprt.errors import InputError
from diffprt.scene import Scene
from diffprt.scene.readers.parts import Part

CORNERS = [(0, 0, 0), (2, 0, 0), (3, 1, 0), (2, 2, 0), (0, 2, 0), (-1, 1, 0)]


def ply(path: Path, faces: list[list[int]], vertex: str = "") -> Path:
    extra = "property float nx\nproperty float ny\nproperty float nz\n" if vertex else ""
    rows = "".join(f"{x} {y} {z}{vertex}\n" for x, y, z in CORNERS)
    rows += "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in faces)
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(CORNERS)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"{extra}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n{rows}"
    )
    return path


@pytest.mark.parametrize("corners", [3, 4, 5, 6])
def test_polygons_become_fans(corners, tmp_path):
    scene = Scene.load(ply(tmp_path / "a.ply", [list(range(corners))]), winding="keep")
    assert scene.meshes[0].faces.tolist() == [[0, k, k + 1] for k in range(1, corners - 1)]


@pytest.mark.parametrize("faces", [[[0, 1]], [[0, 1], [1, 2]], [[], []], [[0]], [[7, 8, 9]], [[-1, 0, 1]]])
def test_faces_of_few_corners_or_none_are_one_line(faces, tmp_path):
    with pytest.raises(InputError) as caught:
        Scene.load(ply(tmp_path / "a.ply", faces))
    assert "\n" not in str(caught.value) and "a" in str(caught.value)


def test_ragged_rows_are_one_line(tmp_path):
    path = ply(tmp_path / "a.ply", [[0, 1, 2]], " 0 0 1")
    sound = path.read_text()
    for ragged in ("3 1 0 0\n", "3 x y z 0 1\n", "3 1 0 0 0 1 9\n"):
        path.write_text(sound.replace("3 1 0 0 0 1\n", ragged))
        try:
            Scene.load(path)
        except InputError as error:
            assert "\n" not in str(error)


def glb(path: Path, **counts: int) -> Path:
    """A square of four vertices; each attribute has as many rows as `counts` says."""
    widths = {"POSITION": 3, "NORMAL": 3, "TEXCOORD_0": 2, "COLOR_0": 3}
    data, views, accessors, attributes = bytearray(), [], [], {}
    arrays = {name: np.ones((count, widths[name]), np.float32) for name, count in counts.items()}
    arrays["POSITION"] = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)
    for name, values in {**arrays, "": np.array([0, 1, 2, 0, 2, 3], np.uint32)}.items():
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[values.shape[1] if values.ndim == 2 else 1]
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": 5126 if name else 5125, "count": len(values), "type": kind}
        )
        if name:
            attributes[name] = len(accessors) - 1
        data += values.tobytes()
    primitive = {"attributes": attributes, "indices": len(accessors) - 1}
    text = json.dumps(
        {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [primitive]}], "buffers": [{"byteLength": len(data)}],
            "bufferViews": views, "accessors": accessors,
        }
    ).encode()  # fmt: skip
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.mark.parametrize("name", ["NORMAL", "TEXCOORD_0", "COLOR_0"])
@pytest.mark.parametrize("count", [0, 1, 3, 5])
def test_attributes_of_another_count_are_one_line(name, count, tmp_path):
    try:
        # What nothing refers to is left out.
        assert Scene.load(glb(tmp_path / "a.glb", **{name: count})).triangle_count == 2 and name != "NORMAL"
    except InputError as error:
        assert "\n" not in str(error) and "a.glb" in str(error)
    assert Scene.load(glb(tmp_path / "a.glb", **{name: 4})).triangle_count == 2


SOUND = {"positions": np.zeros((4, 3)), "faces": np.array([[0, 1, 2]])}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("positions", np.zeros((4, 2))),
        ("positions", np.zeros(4)),
        ("positions", np.zeros((4, 3), object)),
        ("faces", np.zeros((2, 4), int)),
        ("faces", np.zeros((2, 3))),
        ("faces", np.zeros(3, int)),
        ("normals", np.zeros((3, 3))),
        ("normals", np.zeros((4, 3), object)),
        ("uv", np.zeros((4, 3))),
        ("uv", np.zeros((5, 2))),
        ("colors", np.zeros((4, 4))),
        ("colors", np.array([["a"] * 3] * 4)),
    ],
)
def test_parts_that_do_not_belong_together_are_refused(name, values):
    Part(**SOUND, uv=np.zeros((4, 2))).checked()
    with pytest.raises(InputError, match=f"has {name} of"):
        Part(**{**SOUND, name: values}, name="part").checked()


def test_parts_without_faces_have_none():
    assert Part(np.zeros((2, 3)), np.zeros((7, 0))).checked().faces.shape == (0, 3)
