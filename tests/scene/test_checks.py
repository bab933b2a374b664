"""Defects: a table of meshes, what is found in each and what is done about it (hard cases 22 to 25, 28)."""

import time

import numpy as np
import pytest
import torch
import trimesh

from diffprt.errors import InputError
from diffprt.scene import POLICY, Scene

NAN = float("nan")
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], dtype=np.float32)
TWO = [[0, 2, 1], [0, 3, 2]]


def _ball(subdivisions=2):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.array(ball.vertices, dtype=np.float32), np.array(ball.faces)


def _some_flipped(share):
    points, faces = _ball()
    which = np.random.default_rng(0).random(len(faces)) < share
    faces[which] = faces[which][:, ::-1]
    return points, faces


def _hollow():
    points, faces = _ball()
    return np.concatenate([points, points / 2]), np.concatenate([faces, faces[:, ::-1] + len(points)])


def _moebius(count=20):
    turn = np.arange(count) * 2 * np.pi / count
    points = []
    for t in turn:
        for s in (-0.3, 0.3):
            r = 1 + s * np.cos(t / 2)
            points.append([r * np.cos(t), s * np.sin(t / 2), r * np.sin(t)])
    faces = []
    for i in range(count):
        a, b = 2 * i, 2 * i + 1
        c, d = (a + 2, b + 2) if i < count - 1 else (1, 0)
        faces += [[a, b, c], [b, d, c]]
    return np.array(points), np.array(faces)


CASES = {
    "clean": (*_ball(), {"watertight": True, "components": 1, "faces": 320}),
    "one triangle": (SQUARE[:3], [[0, 2, 1]], {"boundary_edges": 3, "watertight": False, "components": 1}),
    "open sheet": (SQUARE, TWO, {"boundary_edges": 4, "flipped_faces": 0}),
    "open sheet facing down": (SQUARE, [[0, 1, 2], [0, 2, 3]], {"boundary_edges": 4, "flipped_faces": 0}),
    "repeated index": (SQUARE, [*TWO, [1, 1, 2]], {"degenerate_faces": 1}),
    "zero area": (np.vstack([SQUARE, [[2, 0, 0]]]), [*TWO, [0, 1, 4]], {"degenerate_faces": 1}),
    "sliver": (
        np.vstack([SQUARE, [[0.5, 0, -0.001]]]),
        [*TWO, [0, 1, 4]],
        {"sliver_faces": 1, "degenerate_faces": 0},
    ),
    "duplicate face": (SQUARE, [*TWO, TWO[0]], {"duplicate_faces": 1, "non_manifold_edges": 0}),
    "duplicate face turned over": (SQUARE, [*TWO, TWO[0][::-1]], {"duplicate_faces": 1, "flipped_faces": 0}),
    "coincident sheet": (
        np.vstack([SQUARE, SQUARE]),
        [*TWO, [4, 6, 5], [4, 7, 6]],
        {"coincident_faces": 2, "coincident_vertices": 4, "duplicate_faces": 0},
    ),
    "unreferenced": (np.vstack([SQUARE, [[9, 9, 9]]]), TWO, {"unreferenced_vertices": 1}),
    "three faces at an edge": (
        np.vstack([SQUARE, [[0.5, 1, 0.5]]]),
        [*TWO, [0, 2, 4]],
        {"non_manifold_edges": 1, "watertight": False},
    ),
    "inside out": (_ball()[0], _ball()[1][:, ::-1], {"inward_components": 1, "flipped_faces": 320}),
    "a few flipped": (*_some_flipped(0.1), {"inward_components": 0, "watertight": True}),
    "mostly flipped": (*_some_flipped(0.9), {"inward_components": 1, "watertight": True}),
    "hollow ball": (*_hollow(), {"cavities": 1, "inward_components": 0, "flipped_faces": 0, "components": 2}),
    "one-sided": (*_moebius(), {"unorientable_components": 1, "flipped_faces": 0}),
}


@pytest.mark.parametrize("name", CASES)
def test_defects_are_counted_and_vertices_kept(name):
    points, faces, expected = CASES[name]
    scene = Scene.from_mesh(points, faces, name=name)
    found = scene.defects.as_dict()
    assert {key: found[key] for key in expected} == expected
    assert np.array_equal(scene.meshes[0].positions.numpy(), np.asarray(points, dtype=np.float32))
    dropped = found["degenerate_faces"] + found["duplicate_faces"]
    assert scene.triangle_count == len(faces) - dropped
    assert torch.allclose(scene.meshes[0].normals.norm(dim=1), torch.ones(len(points)), atol=1e-6)
    for key in expected:
        if found[key] and key in POLICY and key != "components":
            assert any(line.startswith(f"{found[key]} {key.replace('_', ' ')}") for line in scene.defects.lines())


@pytest.mark.parametrize("name", ["inside out", "a few flipped", "mostly flipped"])
@pytest.mark.parametrize("supplied", [None, "outward", "as wound"])
def test_a_closed_mesh_faces_outward_after_loading_never_silent_black(name, supplied):
    points, faces, _ = CASES[name]
    normals = {None: None, "outward": points, "as wound": -points}[supplied]
    if supplied == "as wound" and name == "a few flipped":
        normals = points
    scene = Scene.from_mesh(points, faces, normals)
    mesh = scene.meshes[0]
    corners = mesh.positions[mesh.faces]
    facing = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert bool(((facing * corners.mean(dim=1)).sum(dim=1) > 0).all())
    assert bool(((mesh.normals * mesh.positions).sum(dim=1) > 0.9).all())
    assert scene.defects.flipped_faces > 0


def test_winding_is_only_reported_when_kept():
    points, faces = _ball()
    scene = Scene.from_mesh(points, faces[:, ::-1], winding="keep")
    assert scene.defects.inward_components == 1 and scene.defects.flipped_faces == 0
    assert np.array_equal(scene.meshes[0].faces.numpy(), faces[:, ::-1])
    assert any("inward" in line and "kept" in line for line in scene.defects.lines())


def test_normals_of_the_file_are_checked():
    points, faces = _ball()
    normals = points.copy()
    normals[3], normals[4] = 0, NAN
    normals[10:15] *= -1
    scene = Scene.from_mesh(points, faces, normals)
    assert scene.defects.replaced_normals == 2 and scene.defects.opposed_normals == 5
    assert torch.allclose(scene.meshes[0].normals[3:5], torch.from_numpy(points[3:5]), atol=0.02)


@pytest.mark.parametrize(
    ("points", "faces", "words"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), dtype=int), "0 vertices and 0 faces"),
        (SQUARE, np.zeros((0, 3), dtype=int), "4 vertices and 0 faces"),
        (SQUARE, [[0, 1, 7], [0, -1, 2]], "2 out-of-range indices"),
        (np.where(np.arange(4)[:, None] == 2, NAN, SQUARE), TWO, r"1 non-finite vertices \(first: 2\)"),
        (np.where(np.arange(4)[:, None] >= 2, np.inf, SQUARE), TWO, r"2 non-finite vertices \(first: 2\)"),
        (SQUARE, [[0, 0, 1]], "no face left of 1"),
        (SQUARE[:, :2], TWO, "shape"),
    ],
)
def test_what_cannot_be_baked_is_refused_with_counts(points, faces, words):
    with pytest.raises(InputError, match=words) as caught:
        Scene.from_mesh(points, faces, name="thing")
    assert "thing" in str(caught.value) and "\n" not in str(caught.value)


def test_non_finite_vertices_can_be_dropped_in_place():
    points, faces = _ball()
    points = points.copy()
    points[5] = NAN
    scene = Scene.from_mesh(points, faces, non_finite="drop")
    mesh = scene.meshes[0]
    assert len(mesh.positions) == len(points) and torch.isfinite(mesh.positions).all()
    assert torch.allclose(mesh.positions[5], torch.from_numpy(np.delete(points, 5, axis=0)).mean(dim=0), atol=1e-6)
    assert 5 not in mesh.faces and scene.defects.non_finite_vertices == 1
    assert np.array_equal(np.delete(mesh.positions.numpy(), 5, axis=0), np.delete(points, 5, axis=0))
    with pytest.raises(InputError, match="'refuse' or 'drop'"):
        Scene.from_mesh(points, faces, non_finite="ignore")


def test_seams_do_not_open_a_closed_mesh_and_share_one_normal():
    points, faces = _ball()
    torn = points[faces].reshape(-1, 3)
    scene = Scene.from_mesh(torn, np.arange(len(torn)).reshape(-1, 3))
    whole = Scene.from_mesh(points, faces)
    assert scene.defects.watertight and scene.defects.components == 1 and scene.defects.boundary_edges == 0
    assert torch.equal(scene.meshes[0].normals, scene.meshes[0].normals)
    assert torch.allclose(scene.meshes[0].normals, whole.meshes[0].normals[faces.reshape(-1)], atol=1e-6)
    first = {}
    for position, normal in zip(torn.tolist(), scene.meshes[0].normals.tolist(), strict=True):
        assert first.setdefault(tuple(position), normal) == normal


def test_both_sides_of_a_paper_keep_their_own_normals():
    scene = Scene.from_mesh(np.vstack([SQUARE, SQUARE]), [*TWO, [4, 5, 6], [4, 6, 7]], winding="keep")
    assert torch.allclose(scene.meshes[0].normals[:4, 1], torch.ones(4))
    assert torch.allclose(scene.meshes[0].normals[4:, 1], -torch.ones(4))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_findings_do_not_depend_on_scale(scale):
    points, faces, _ = CASES["sliver"]
    found = Scene.from_mesh(points * np.float32(scale), faces).defects
    assert found.sliver_faces == 1 and found.degenerate_faces == 0


def test_checks_are_fast_enough_for_a_scan():
    points, faces = _ball(7)
    faces = faces.copy()
    faces[::3] = faces[::3, ::-1]
    start = time.perf_counter()
    scene = Scene.from_mesh(points, faces)
    # 327,680 triangles take about a second; the bound leaves room for a busy machine.
    assert time.perf_counter() - start < 6
    assert scene.defects.watertight and scene.defects.flipped_faces == len(faces[::3])
