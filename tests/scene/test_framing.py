"""Cameras that frame the object, not the ground under it."""

import math

import numpy as np
import pytest
import torch

from diffprt.errors import InputError
from diffprt.scene import BUILTIN_SCENES, Camera, Scene, builtin_scene
from diffprt.surface.surfaces import Surfaces

SIZES = ((96, 96), (160, 90), (60, 120))


@pytest.fixture(scope="module")
def scenes():
    return {name: builtin_scene(name, subdivisions=0) for name in BUILTIN_SCENES}


def fill(camera: Camera, positions: torch.Tensor) -> tuple[float, float]:
    """Shares of the width and the height between the outermost points."""
    view = camera.view()
    local = positions.double() @ view[:3, :3].T + view[:3, 3]
    clip = torch.cat([local, torch.ones(len(local), 1)], 1).double() @ camera.projection(0.1, 10.0).T
    flat = clip[:, :2] / clip[:, 3:]
    assert float(flat.abs().max()) <= 1.0 and float(clip[:, 3].min()) > 0
    width, height = ((flat.amax(0) - flat.amin(0)) / 2).tolist()
    return width, height


@pytest.mark.parametrize("ground", [None, {}, {"size": 1.2}, {"size": 8.0, "clearance": 0.3}], ids=str)
@pytest.mark.parametrize("name", BUILTIN_SCENES)
def test_the_object_fills_more_than_half_of_the_height_or_the_width(name, ground, scenes):
    scene = scenes[name]
    own = torch.cat([mesh.positions for mesh in scene.meshes])
    scene = scene if ground is None else scene.with_ground(resolution=8, **ground)
    # Something large that only blocks light is not looked at either.
    wall = builtin_scene("sphere", subdivisions=0).transformed(np.diag([9.0, 9.0, 9.0, 1.0]))
    receivers = Surfaces.of(scene.with_occluder(wall)).receivers
    assert len(receivers.subject) == len(own)
    for width, height in SIZES:
        assert max(fill(Camera.framing(receivers.subject, width=width, height=height), own)) > 0.5


def test_a_ground_of_a_file_is_one_too_and_a_floor_with_walls_is_not(scenes):
    ball = scenes["sphere"].meshes[0]
    square = torch.tensor([[-9.0, -1.0, -9.0], [9.0, -1.0, -9.0], [9.0, -1.0, 9.0], [-9.0, -1.0, 9.0]])
    positions = torch.cat([ball.positions, square])
    faces = torch.cat([ball.faces, torch.tensor([[0, 2, 1], [0, 3, 2]]) + len(ball.positions)])
    receivers = Surfaces.of(Scene.from_mesh(positions, faces, winding="keep")).receivers
    assert len(receivers.subject) == len(ball.positions)
    for name in ("cornell", "wall_and_floor", "closed_box"):
        own = Surfaces.of(scenes[name]).receivers
        assert len(own.subject) == len(own)
    alone = Surfaces.of(Scene.from_mesh(square, torch.tensor([[0, 2, 1], [0, 3, 2]]), winding="keep")).receivers
    assert len(alone.subject) == 4


def test_target_and_distance_are_where_the_camera_goes(scenes):
    points = scenes["bowl"].meshes[0].positions
    camera = Camera.framing(points, target=(1.0, 2.0, 3.0), distance=4.0, azimuth=0, elevation=0, fov=50)
    assert camera.target == (1.0, 2.0, 3.0) and camera.fov == 50
    assert camera.eye == pytest.approx((1.0, 2.0, 7.0))
    aside = Camera.framing(points, target=(2.0, 0.0, 0.0))
    assert max(fill(aside, points)) < max(fill(Camera.framing(points), points))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused_by_name(bad, scenes):
    points = scenes["sphere"].meshes[0].positions
    for name in ("azimuth", "elevation", "fov", "distance"):
        with pytest.raises(InputError, match=f"{name} is {bad}"):
            Camera.framing(points, **{name: bad})
    with pytest.raises(InputError, match="camera has target"):
        Camera.framing(points, target=(0.0, bad, 0.0))
    with pytest.raises(InputError, match="camera has eye"):
        Camera((bad, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="distance is 0"):
        Camera.framing(points, distance=0.0)
