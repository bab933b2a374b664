"""The comparison with Mitsuba: its statistics, the conversions, agreement, and that it can disagree."""

import importlib
import math
import sys

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene import Camera, Light, Scene, builtin_environment, builtin_scene
from diffprt.study.mitsuba import scene as peer_scene
from diffprt.study.reference.agreement import agreement, eroded
from diffprt.study.reference.study import compare, receiver_pixels, reference_study
from diffprt.transfer import bake

SIZE, BOUNCES = 64, 3


@pytest.fixture(scope="module")
def mitsuba():
    pytest.importorskip("mitsuba")
    return peer_scene.start_mitsuba()[0]


@pytest.fixture(scope="module")
def lumpy() -> Scene:
    """10,242 vertices with dents that shadow and reflect, colored, so that three channels are compared."""
    ball = builtin_scene("sphere", subdivisions=5).meshes[0]
    p = ball.positions.double()
    scale = 1 + 0.3 * (5 * p[:, :1]).sin() * (7 * p[:, 1:2]).sin() * (6 * p[:, 2:]).sin()
    return Scene.from_mesh((p * scale).float(), ball.faces, albedo=(0.8, 0.5, 0.3), name="lumpy")


@pytest.fixture(scope="module")
def baked(lumpy):
    return bake(lumpy, order=6, rays=512, bounces=BOUNCES)


@pytest.fixture(scope="module")
def camera(baked) -> Camera:
    return Camera.framing(baked.receivers.positions, width=SIZE, height=SIZE)


@pytest.fixture(scope="module")
def sky() -> Light:
    return builtin_environment("sky").project(6, window="auto")


def test_agrees_with_mitsuba(mitsuba, lumpy, baked, camera, sky):
    visible = receiver_pixels(lumpy, camera)
    row, pictures = compare(mitsuba, lumpy, baked, sky, camera, visible, bounces=BOUNCES, samples=512)
    assert row["pixels"] > SIZE * SIZE / 4
    assert row["relative_rmse"] < 0.02
    assert row["resolution"] < 0.01
    # Two halves from the same random numbers would hide the reference's noise, and count it as our error.
    assert row["noise"] > 0.005
    assert row["mean_ratio"] == pytest.approx(1, abs=0.005)
    assert bool(torch.isfinite(pictures["ours"]).all() and torch.isfinite(pictures["mitsuba"]).all())


def test_a_turned_light_disagrees(mitsuba, lumpy, baked, camera, sky):
    quarter = torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    row, _ = compare(
        mitsuba,
        lumpy,
        baked,
        sky,
        camera,
        receiver_pixels(lumpy, camera),
        bounces=BOUNCES,
        samples=64,
        reference_light=sky.rotate(quarter),
    )
    assert row["relative_rmse"] > 0.1


def test_missing_bounces_disagree(mitsuba, lumpy, baked, camera, sky):
    row, _ = compare(mitsuba, lumpy, baked, sky, camera, receiver_pixels(lumpy, camera), bounces=0, samples=256)
    assert row["mean_ratio"] > 1.02


def test_mitsuba_sees_the_light_where_it_is(mitsuba):
    """The emitter, evaluated in random directions and at the poles, is the band-limited light."""
    generator = torch.Generator().manual_seed(3)
    coefficients = torch.randn(36, 3, generator=generator)
    coefficients[0] += 40
    light = Light(coefficients)
    image = mitsuba.Bitmap(peer_scene.mitsuba_map(light).numpy())
    emitter = mitsuba.load_dict({"type": "envmap", "bitmap": image})
    random = torch.randn(200, 3, generator=generator)
    # A hair off the axes: exactly at its south pole Mitsuba's look-up wraps around to the north.
    axes = torch.cat([torch.eye(3), -torch.eye(3)]) + torch.tensor([1e-3, 2e-3, -1e-3])
    directions = torch.nn.functional.normalize(torch.cat([random, axes]), dim=-1)
    error = (emitted(mitsuba, emitter, directions) - light.radiance(directions)).abs().max()
    variation = float(coefficients[1:].norm(dim=0).max()) / math.sqrt(4 * math.pi)
    assert float(error) < 2e-3 * variation


def emitted(mitsuba, emitter, directions: torch.Tensor) -> torch.Tensor:
    """Radiance [N, 3] that reaches the origin from `directions` [N, 3], in scalar and vectorized variants."""
    drjit = importlib.import_module("drjit")
    if mitsuba.variant().startswith("scalar"):
        interaction = mitsuba.SurfaceInteraction3f()
        rows = []
        for direction in directions:
            interaction.wi = mitsuba.Vector3f((-direction).tolist())
            rows.append(list(emitter.eval(interaction)))
        return torch.tensor(rows)
    interaction = drjit.zeros(mitsuba.SurfaceInteraction3f, len(directions))
    interaction.wi = mitsuba.Vector3f(*(-directions).T.contiguous().numpy())
    return torch.from_numpy(np.array(emitter.eval(interaction))).reshape(3, -1).T


def test_the_map_has_its_poles_on_rows_and_its_seam_at_minus_z():
    """A lobe towards -z lands on the middle row, at the left and right border; each pole is one color."""
    zonal = sh.rotate_zonal(sh.clamped_cosine(4), torch.tensor([0.0, 0.0, -1.0]))
    lobe = Light(zonal[:, None].expand(-1, 3) + 2 * torch.eye(16)[0, :, None])
    image = peer_scene.mitsuba_map(lobe, 65)
    assert image.shape == (65, 130, 3)
    row, column = divmod(int(image[..., 0].argmax()), 130)
    assert row == 32
    assert column in (0, 129)
    for pole in (0, 64):
        assert float(image[pole].std(0).max()) < 1e-6


def test_negative_light_is_refused():
    ringing = Light(sh.basis(torch.tensor([0.0, 1.0, 0.0]), 6)[:, None].expand(-1, 3))
    with pytest.raises(InputError, match="window='auto'"):
        peer_scene.mitsuba_map(ringing, 32)


def test_error_is_found_under_noise(generator):
    truth = 1 + torch.rand(128, 128, 3, generator=generator, dtype=torch.float64)
    halves = tuple(truth + 0.3 * torch.randn(truth.shape, generator=generator, dtype=torch.float64) for _ in "ab")
    mask = torch.ones(128, 128, dtype=torch.bool)
    exact = agreement(truth, halves, mask)
    assert exact["relative_rmse"] <= 1.5 * exact["resolution"]
    assert exact["difference"] == pytest.approx(exact["noise"], rel=0.02)
    off = agreement(1.1 * truth, halves, mask)
    assert off["relative_rmse"] == pytest.approx(0.1, rel=0.05)
    assert off["mean_ratio"] == pytest.approx(1.1, rel=0.01)


def test_erosion_takes_one_pixel():
    mask = torch.zeros(9, 9, dtype=torch.bool)
    mask[2:7, 0:6] = True
    expected = torch.zeros(9, 9, dtype=torch.bool)
    expected[3:6, 1:5] = True
    assert torch.equal(eroded(mask), expected)


def test_occluders_before_the_object_are_left_out(lumpy, camera):
    free = receiver_pixels(lumpy, camera)
    eye, target = torch.tensor(camera.eye), torch.tensor(camera.target)
    ball = builtin_scene("sphere", subdivisions=2).meshes[0]
    between = Scene.from_mesh(ball.positions * 0.2 + (eye + target) / 2, ball.faces)
    covered = receiver_pixels(lumpy.with_occluder(between), camera)
    assert 0 < int(covered.sum()) < int(free.sum())
    assert not bool((covered & ~free).any())


def test_the_study_writes_its_pictures(mitsuba, tmp_path):
    report = reference_study(
        "builtin:sphere", ["studio"], tmp_path, order=3, rays=64, bounces=0, size=24, samples=64, albedo=0.5
    )
    (row,) = report["rows"]
    assert row["mean_ratio"] == pytest.approx(1, abs=0.03)
    assert report["versions"]["variant"] == mitsuba.variant()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "sphere_studio.png",
        "sphere_studio_difference.exr",
        "sphere_studio_mitsuba.exr",
        "sphere_studio_ours.exr",
    ]


def test_without_mitsuba_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(peer_scene, "find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "mitsuba", raising=False)
    with pytest.raises(InputError, match=r'pip install "diffprt\[study\]"'):
        peer_scene.start_mitsuba()
