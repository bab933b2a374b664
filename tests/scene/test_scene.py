"""Scenes: materials, ground, occluders, transforms, the merged geometry and the hash."""

import numpy as np
import pytest
import torch
import trimesh

from diffprt.brdf import GGX, Lambert
from diffprt.errors import InputError
from diffprt.scene import Material, Mesh, Scene, builtin_scene, load_scene

PINNED = "5a9520cdf66d03a663be08de76907710553bbf7ea7de34906c249a8589dbef1b"


@pytest.fixture
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    return Scene.from_mesh(mesh.vertices, mesh.faces, albedo=0.5, name="ball")


def test_material_is_checked():
    assert Material(0.5).albedo.tolist() == [0.5, 0.5, 0.5]
    for arguments, words in (
        ({"albedo": 1.5}, r"albedo \[1.5, 1.5, 1.5\]"),
        ({"albedo": (0.1, -0.1, 0.2)}, "albedo"),
        ({"albedo": float("nan")}, "albedo"),
        ({"albedo": (0.1, 0.2)}, "three numbers"),
        ({"albedo": 1, "brdf": "phong7"}, "material 'x' has BRDF 'phong7': give a diffprt.brdf.Brdf, .* or None"),
        ({"albedo": 1, "albedo_texture": torch.full((2, 2, 3), 2.0)}, "texture from 2 to 2"),
        ({"albedo": 1, "albedo_texture": torch.zeros(2, 2)}, "shape"),
    ):
        with pytest.raises(InputError, match=words):
            Material(**arguments, name="x")


def test_texture_is_bilinear_and_repeats():
    texture = torch.tensor([[[1.0, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]])
    material = Material((0.5, 1.0, 1.0), albedo_texture=texture)
    uv = torch.tensor([[0.25, 0.25], [1.25, -0.75], [0.5, 0.25], [0.25, 0.5], [0.0, 0.25], [0.5, 0.5]])
    expected = torch.tensor([[1, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0.5, 0.5, 0], [0.5, 0.5, 0.5]])
    assert torch.allclose(material.sample(uv), expected * torch.tensor([0.5, 1, 1]), atol=1e-6)


def test_gradients_reach_texture_albedo_and_vertex_colours():
    texture = torch.rand(4, 5, 3, dtype=torch.float64, requires_grad=True)
    uv = torch.rand(7, 2, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda t: Material(1.0, albedo_texture=t).sample(uv), (texture,))
    albedo = torch.tensor([0.2, 0.3, 0.4], requires_grad=True)
    colors = torch.rand(3, 3, requires_grad=True)
    mesh = Mesh.create(np.eye(3), [[0, 1, 2]], colors=colors)
    Scene((mesh,), (Material(albedo),)).merged().albedo.sum().backward()
    assert torch.allclose(albedo.grad, colors.detach().sum(dim=0)) and colors.grad is not None


def test_mesh_create_checks_shapes():
    for arguments, words in (
        ({"positions": np.zeros((3, 2)), "faces": [[0, 1, 2]]}, "positions of shape"),
        ({"positions": np.eye(3), "faces": [[0, 1]]}, "faces of shape"),
        ({"positions": np.eye(3), "faces": [[0, 1, 3]]}, "outside 0..2"),
        ({"positions": np.eye(3), "faces": [[0, 1, 2]], "normals": np.zeros((3, 3))}, "3 normals"),
        ({"positions": np.eye(3), "faces": [[0, 1, 2]], "uv": np.zeros((2, 2))}, "uv of shape"),
        ({"positions": np.eye(3), "faces": [[0, 1, 2]], "colors": np.zeros((2, 3))}, "colors of shape"),
    ):
        with pytest.raises(InputError, match=words):
            Mesh.create(**arguments, name="x")


def test_meshes_do_not_share_memory_with_their_input():
    points, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]])
    mesh = Mesh.create(torch.from_numpy(points), faces)
    points[:] = 7
    faces[:] = 0
    assert mesh.positions.max() == 1 and mesh.faces.tolist() == [[0, 1, 2]]


def test_smooth_normals_of_a_ball_and_of_a_cube_corner():
    ball = trimesh.creation.icosphere(subdivisions=4)
    mesh = Mesh.create(ball.vertices, ball.faces)
    assert float((mesh.normals * mesh.positions).sum(dim=1).min()) > 0.99998
    box = trimesh.creation.box()
    # Weights by angle make the diagonal exact whatever the triangulation of the sides.
    corner = Mesh.create(box.vertices, box.faces)
    assert torch.allclose(corner.normals, torch.from_numpy(np.sign(box.vertices) / np.sqrt(3)).float(), atol=1e-6)


def test_bounds_and_counts(ball):
    assert torch.allclose(ball.bounds, torch.tensor([[-1.0, -1, -1], [1, 1, 1]]))
    assert ball.diagonal == pytest.approx(2 * 3**0.5) and (ball.vertex_count, ball.triangle_count) == (
        162,
        320,
    )
    far = ball.with_ground()
    assert torch.equal(far.object_bounds, ball.bounds) and far.diagonal > ball.diagonal


def test_ground_lies_under_the_object_and_faces_up(ball):
    scene = ball.with_ground(size=3, resolution=16, albedo=0.3)
    ground = scene.meshes[-1]
    assert ground.ground and not ground.occluder_only and len(ground.positions) == 17**2
    assert -1.001 < float(ground.positions[:, 1].max()) < -1 and ground.positions[:, 1].unique().numel() == 1
    extent = ground.positions.amax(dim=0) - ground.positions.amin(dim=0)
    assert torch.allclose(extent[[0, 2]], torch.tensor(3 * ball.diagonal), rtol=1e-5)
    corners = ground.positions[ground.faces]
    facing = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert bool((facing[:, 1] > 0).all())
    assert float(facing[:, 1].sum() / 2) == pytest.approx(float(extent[0] * extent[2]), rel=1e-4)
    steps = ground.positions[:17, 0].diff()
    assert float(steps.min()) == pytest.approx(float(steps[8]), rel=1e-4) and steps[0] > 3 * steps[8]
    assert scene.merged().albedo[-1].tolist() == pytest.approx([0.3] * 3)
    raised = ball.with_ground(clearance=0.1).meshes[-1]
    assert float(ground.positions[0, 1] - raised.positions[0, 1]) == pytest.approx(0.1 * ball.diagonal, rel=1e-4)
    with pytest.raises(InputError, match="has a ground"):
        scene.with_ground()
    for bad in ({"size": 0}, {"resolution": 0}, {"clearance": -1}):
        with pytest.raises(InputError, match="ground has"):
            ball.with_ground(**bad)


def test_occluders_bring_their_materials(ball):
    both = ball.with_occluder(builtin_scene("sphere", subdivisions=1).with_albedo(0.25))
    assert [mesh.occluder_only for mesh in both.meshes] == [False, True]
    merged = both.merged()
    assert torch.equal(merged.albedo[merged.mesh_of_vertex == 1].unique(), torch.tensor([0.25]))
    assert torch.equal(both.object_bounds, ball.bounds)
    mesh = Mesh.create(np.eye(3), [[0, 1, 2]])
    assert ball.with_occluder(mesh).meshes[1].occluder_only


def test_merged_concatenates_in_order(ball):
    scene = ball.with_ground(resolution=2).with_albedo((0.1, 0.2, 0.3))
    merged = scene.merged()
    assert merged.positions.dtype == merged.normals.dtype == merged.albedo.dtype == torch.float32
    assert merged.faces.dtype == merged.mesh_of_face.dtype == torch.int64
    assert merged.mesh_of_vertex.tolist() == [0] * 162 + [1] * 9
    assert merged.mesh_of_face.tolist() == [0] * 320 + [1] * 8
    assert torch.equal(merged.faces[320:], scene.meshes[1].faces + 162)
    assert torch.allclose(merged.albedo, torch.tensor([0.1, 0.2, 0.3]).expand(171, 3))


def test_transform_turns_normals_and_mirrors_faces(ball):
    angle = 0.3
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    for matrix in (turn, np.diag([-1.0, 1, 1, 1]), np.diag([1.0, 3, 0.5, 1]), np.diag([1e3, 1e3, 1e3, 1])):
        moved = ball.transformed(matrix).meshes[0]
        expected = ball.meshes[0].positions.double() @ torch.from_numpy(matrix[:3, :3].T)
        assert torch.allclose(moved.positions.double(), expected, rtol=1e-6, atol=1e-6)
        corners = moved.positions[moved.faces]
        facing = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert bool(((facing[:, None] * moved.normals[moved.faces]).sum(dim=-1) > 0).all())
        assert torch.allclose(moved.normals.norm(dim=1), torch.ones(162), atol=1e-6)
    for matrix in (np.zeros((4, 4)), np.eye(3)):
        with pytest.raises(InputError, match="invertible"):
            ball.transformed(matrix)


def test_hash_is_stable_and_notices_what_matters(ball):
    triangle = Scene.from_mesh(np.eye(3), [[0, 1, 2]], albedo=0.5)
    # Pinned, so that an asset baked elsewhere still finds its scene.
    assert triangle.hash() == PINNED
    again = Scene.from_mesh(np.eye(3), [[0, 1, 2]], albedo=0.5, name="other name")
    assert again.hash() == triangle.hash() and len(ball.hash()) == 64
    changed = [
        triangle.with_albedo(0.4),
        triangle.with_ground(),
        triangle.transformed(np.diag([1, 1, 2, 1])),
        Scene.from_mesh(np.eye(3), [[1, 2, 0]], albedo=0.5),
        Scene.from_mesh(np.eye(3), [[0, 1, 2]], np.eye(3), albedo=0.5),
        Scene.from_mesh(np.eye(3), [[0, 1, 2]], albedo=0.5, colors=np.ones((3, 3))),
        Scene((Mesh.create(np.eye(3), [[0, 1, 2]], occluder_only=True),), (Material(0.5),)),
    ]
    hashes = {scene.hash() for scene in changed}
    assert len(hashes) == len(changed) and triangle.hash() not in hashes


def test_scenes_are_checked():
    mesh = Mesh.create(np.eye(3), [[0, 1, 2]], material=2)
    with pytest.raises(InputError, match="no meshes"):
        Scene((), ())
    with pytest.raises(InputError, match="material 2"):
        Scene((mesh,), (Material(1.0),))


def test_load_scene_takes_what_a_user_types(ball, tmp_path):
    trimesh.creation.box().export(tmp_path / "box.ply")
    assert load_scene(ball) is ball
    assert load_scene(str(tmp_path / "box.ply")).name == "box"
    assert load_scene("builtin:sphere").hash() == Scene.load("builtin:sphere").hash()
    with pytest.raises(InputError, match="'teapot' is unknown: known are bunny"):
        load_scene("builtin:teapot")


def test_brdfs_stand_in_materials_and_leave_the_hash():
    scene = builtin_scene("sphere").with_ground()
    shiny = scene.with_brdf([GGX(0.3), Lambert(0.5)])
    assert not scene.glossy and shiny.glossy and shiny.hash() == scene.hash()
    assert [type(m.brdf) for m in shiny.materials] == [GGX, Lambert]
    one = GGX(0.4)
    assert all(m.brdf is one for m in scene.with_brdf(one).materials)
    with pytest.raises(InputError, match=r"3 BRDFs for 2 materials of scene 'sphere': give one, or one per material"):
        scene.with_brdf([one, one, one])
