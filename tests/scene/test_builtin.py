"""Built-in scenes have the counts, sizes and orientation that the hard cases rely on."""

import numpy as np
import pytest
import torch
import trimesh

from diffprt.errors import InputError
from diffprt.scene import BUILTIN_SCENES, builtin_scene
from diffprt.scene.icosphere import icosphere

COUNTS = {
    "bunny": (24402, 48800),
    "sphere": (2562, 5120),
    "bowl": (16385, 32512),
    "wall_and_floor": (2450, 4608),
    "closed_box": (1734, 3072),
    "cornell": (2255, 3840),
}


@pytest.fixture(scope="module")
def scenes():
    return {name: builtin_scene(name) for name in BUILTIN_SCENES}


def _facing(mesh):
    corners = mesh.positions.double()[mesh.faces]
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.mean(dim=1)


def test_every_scene_is_in_the_table():
    assert set(COUNTS) == set(BUILTIN_SCENES)


@pytest.mark.parametrize("name", COUNTS)
def test_counts_normals_and_winding_agree(scenes, name):
    scene = scenes[name]
    assert (scene.vertex_count, scene.triangle_count) == COUNTS[name]
    for mesh in scene.meshes:
        facing, _ = _facing(mesh)
        assert bool(((facing[:, None] * mesh.normals[mesh.faces]).sum(dim=-1) > 0).all())
    report = scene.defects
    assert report.degenerate_faces == report.duplicate_faces == report.inconsistent_edges == 0
    assert report.non_manifold_edges == report.unreferenced_vertices == 0
    assert report.watertight == (name in ("bunny", "sphere", "closed_box"))


def test_bunny_stands_upright_and_starts_from_the_file():
    coarse = builtin_scene("bunny", subdivisions=0)
    assert (coarse.vertex_count, coarse.triangle_count) == (6102, 12200)
    assert coarse.defects.watertight and coarse.defects.components == 1 and coarse.defects.inward_components == 0
    low, high = coarse.bounds
    assert high[1] - low[1] == pytest.approx(1.62, abs=0.05) and abs(low[1]) < 0.1


def test_sphere_is_exact(scenes):
    mesh = scenes["sphere"].meshes[0]
    assert torch.allclose(mesh.positions.norm(dim=1), torch.ones(2562), atol=1e-6)
    assert torch.allclose(mesh.normals, mesh.positions, atol=1e-6)
    assert builtin_scene("sphere", subdivisions=5).vertex_count == 10242


@pytest.mark.parametrize("subdivisions", [0, 1, 4])
def test_sphere_is_that_of_trimesh(subdivisions):
    ours, theirs = icosphere(subdivisions), trimesh.creation.icosphere(subdivisions=subdivisions)
    assert ours[0].tobytes() == np.asarray(theirs.vertices).tobytes() and np.array_equal(ours[1], theirs.faces)


def test_bowl_is_half_a_sphere_seen_from_within(scenes):
    mesh = scenes["bowl"].meshes[0]
    assert torch.allclose(mesh.positions.norm(dim=1), torch.ones(16385), atol=1e-6)
    assert torch.allclose(mesh.normals, -mesh.positions, atol=1e-6)
    assert float(mesh.positions[:, 1].max()) == 0 and int((mesh.positions[:, 1] == 0).sum()) == 256
    facing, centers = _facing(mesh)
    assert bool(((facing * -centers).sum(dim=1) > 0).all())
    assert float(facing.norm(dim=1).sum() / 2) == pytest.approx(2 * np.pi, rel=1e-3)
    assert scenes["bowl"].defects.boundary_edges == 256


def test_wall_and_floor_meet_on_the_z_axis(scenes):
    floor, wall = scenes["wall_and_floor"].meshes
    assert float(floor.positions[:, 1].abs().max()) == 0 and float(wall.positions[:, 0].abs().max()) == 0
    assert torch.allclose(_facing(floor)[0][:, 1].sign(), torch.ones(1, dtype=torch.float64))
    assert torch.allclose(_facing(wall)[0][:, 0].sign(), torch.ones(1, dtype=torch.float64))
    assert bool((floor.positions == torch.tensor([1.0, 0, 0])).all(dim=1).any())
    on_axis = [m.positions[(m.positions[:, :2] == 0).all(dim=1)] for m in (floor, wall)]
    assert torch.equal(*on_axis) and len(on_axis[0]) > 10
    assert float(builtin_scene("wall_and_floor", size=50).bounds[1].max()) == 50
    with pytest.raises(InputError, match="size=1"):
        builtin_scene("wall_and_floor", size=1)


def test_closed_box_faces_inward_with_exact_normals(scenes):
    mesh = scenes["closed_box"].meshes[0]
    facing, centers = _facing(mesh)
    assert bool(((facing * centers).sum(dim=1) < 0).all())
    assert float(facing.norm(dim=1).sum() / 2) == pytest.approx(24)
    assert torch.equal(mesh.normals.abs().sum(dim=1), torch.ones(1734))
    assert scenes["closed_box"].defects.inward_components == 1


def test_cornell_room_is_open_to_the_front_and_coloured(scenes):
    scene = scenes["cornell"]
    merged = scene.merged()
    assert scene.bounds.tolist() == [[-1, 0, -1], [1, 2, 1]]
    red = merged.albedo[(merged.positions[:, 0] == -1) & (merged.normals[:, 0] == 1)]
    green = merged.albedo[(merged.positions[:, 0] == 1) & (merged.normals[:, 0] == -1)]
    assert len(red) == len(green) == 17**2
    assert bool((red[:, 0] > 4 * red[:, 1]).all() and (green[:, 1] > 2 * green[:, 0]).all())
    names = [mesh.name for mesh in scene.meshes]
    assert names == ["floor", "ceiling", "back", "left", "right", "short block", "tall block"]
    middle = torch.tensor([0.0, 1, 0], dtype=torch.float64)
    for mesh in scene.meshes[:5]:
        facing, centers = _facing(mesh)
        assert bool(((facing * (middle - centers)).sum(dim=1) > 0).all())
    for mesh, height in zip(scene.meshes[5:], (0.6, 1.2), strict=True):
        facing, centers = _facing(mesh)
        inside = mesh.positions.double().mean(dim=0)
        assert bool(((facing * (centers - inside)).sum(dim=1) > 0).all())
        assert float(mesh.positions[:, 1].max()) == pytest.approx(height)
        assert float(mesh.positions[:, [0, 2]].abs().max()) < 1


def test_bad_arguments_name_the_choices():
    with pytest.raises(InputError, match="known are bunny, sphere"):
        builtin_scene("teapot")
    with pytest.raises(InputError, match="subdivisions=9"):
        builtin_scene("sphere", subdivisions=9)
    with pytest.raises(InputError, match="only 'wall_and_floor'"):
        builtin_scene("sphere", size=9.0)
