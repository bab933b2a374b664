"""The rasterizer against its plain-torch twin."""

import pytest
import torch
from tolerances import FLOAT32

from diffprt.kernels.raster import rasterize
from diffprt.rendering.reference import rasterize_reference
from diffprt.scene import Camera, builtin_scene


def clip_positions(positions: torch.Tensor, camera: Camera) -> torch.Tensor:
    homogeneous = torch.cat([positions.double(), torch.ones(len(positions), 1)], dim=1)
    return homogeneous @ (camera.projection(*camera.depth_range(positions)) @ camera.view()).T


@pytest.mark.parametrize("distance", ["outside", "inside"])
def test_agrees_with_the_twin(bumpy, distance):
    merged = bumpy.merged()
    camera = Camera.framing(merged.positions, width=61, height=43)
    if distance == "inside":
        camera = Camera((0.1, 0.2, 0.3), (0.5, 0.1, -1.0), fov=80, width=61, height=43)
    clip = clip_positions(merged.positions, camera)
    face, weights, depth = rasterize(clip, merged.faces, 61, 43)
    twin_face, twin_weights, twin_depth = rasterize_reference(clip, merged.faces, 61, 43)
    covered = face >= 0
    assert int(covered.sum()) > 500
    different = face != twin_face
    assert float(different.float().mean()) < 1e-3
    same = covered & ~different
    assert float((weights - twin_weights)[same].abs().max()) < FLOAT32["twin"]
    assert float((depth / twin_depth - 1)[same].abs().max()) < FLOAT32["twin"]
    assert float((weights[covered].sum(-1) - 1).abs().max()) < FLOAT32["rounding"]


def test_neighbouring_triangles_leave_no_gap(bumpy):
    """A closed surface that fills the picture covers every pixel, subpixel triangles included."""
    merged = bumpy.merged()
    camera = Camera((0.0, 0.0, 0.2), (0.0, 0.3, -1.0), fov=100, width=97, height=97)
    face, _, _ = rasterize(clip_positions(merged.positions, camera), merged.faces, 97, 97)
    assert int((face < 0).sum()) == 0
    ball = builtin_scene("sphere", subdivisions=6).merged()
    far = Camera((0.0, 0.0, 60.0), (0.0, 0.0, 0.0), fov=2.5, width=48, height=48)
    face, _, _ = rasterize(clip_positions(ball.positions, far), ball.faces, 48, 48)
    mask = face >= 0
    assert int(mask.sum()) > 1000
    for row in mask[mask.any(1)]:
        columns = row.nonzero().flatten()
        assert len(columns) == int(columns[-1] - columns[0]) + 1


def test_any_thread_count_and_face_order_give_the_same_picture(bumpy):
    merged = bumpy.merged()
    clip = clip_positions(merged.positions, Camera.framing(merged.positions, width=200, height=200))
    one = rasterize(clip, merged.faces, 200, 200, threads=1)
    four = rasterize(clip, merged.faces, 200, 200, threads=4)
    for a, b in zip(one, four, strict=True):
        assert torch.equal(a, b)
    back = rasterize(clip, merged.faces.flip(0), 200, 200)
    seen = one[0] >= 0
    assert torch.equal(back[0][seen], (len(merged.faces) - 1 - one[0])[seen])
