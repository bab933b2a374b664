"""`tolerance` and `seconds`: the chosen rays deliver the error that was asked for, and say so honestly."""

import itertools
import math

import pytest
import torch

from diffprt.errors import InputError
from diffprt.scene import Scene, builtin_scene
from diffprt.transfer import BakeSettings, bake, choose_rays, rays_for_tolerance


def relative_error(rough: torch.Tensor, fine: torch.Tensor) -> float:
    return float((rough - fine).double().square().sum(-1).mean().sqrt() / fine.double().square().sum(-1).mean().sqrt())


def random_blob(seed: int) -> Scene:
    """A sphere dented by a few random waves."""
    generator = torch.Generator().manual_seed(seed)
    ball = builtin_scene("sphere", subdivisions=4).meshes[0]
    waves = 8 * torch.rand(4, 3, generator=generator)
    phases = 6 * torch.rand(4, generator=generator)
    scale = 1 + 0.2 * torch.sin(ball.positions @ waves.T + phases).sum(1)
    return Scene.from_mesh(ball.positions * scale[:, None], ball.faces, albedo=0.6, name=f"blob {seed}")


SCENES = {
    "bumpy": None,
    "bunny": lambda: builtin_scene("bunny", subdivisions=0),
    "bowl": lambda: builtin_scene("bowl", subdivisions=2),
    "cornell": lambda: builtin_scene("cornell"),
    "blob 1": lambda: random_blob(1),
    "blob 2": lambda: random_blob(2),
}


@pytest.mark.parametrize("name", list(SCENES))
def test_tolerance_is_met_at_no_more_than_twice_the_cost(name, bumpy):
    scene = bumpy if name == "bumpy" else SCENES[name]()
    tolerance = 0.02
    report: dict = {}
    rough = bake(scene, order=4, bounces=1, tolerance=tolerance, report=report)
    rays = report["settings"]["rays"]
    fine = bake(scene, order=4, bounces=1, rays=16 * rays, seed=7)
    error = relative_error(rough.diffuse, fine.diffuse)
    assert error <= tolerance
    estimate = rough.certificate["estimated_error"]
    assert error < 1.15 * estimate and estimate < 2.0 * error, "the estimate is honest"
    # The error falls like N^-3/4: half the rays would leave 1.68 times of it.
    best = rays * (error / tolerance) ** (4 / 3)
    spent = rays + report["sampling"]["pilot_rays"] / len(rough.receivers)
    small = len(rough.receivers) < 8000
    assert spent < (2.6 if small else 2.0) * best, "on a small mesh the pilot weighs more"


def test_tolerance_is_the_same_for_any_thread_count(bumpy):
    settings = BakeSettings(order=3, bounces=0)
    one, four = (rays_for_tolerance(bumpy, settings, 0.02, threads=n) for n in (1, 4))
    assert one == four


def test_smaller_tolerances_take_more_rays(bumpy):
    settings = BakeSettings(order=3, bounces=0)
    rates = [rays_for_tolerance(bumpy, settings, t) for t in (0.1, 0.03, 0.01, 0.003)]
    assert all(a.rays < b.rays for a, b in itertools.pairwise(rates))
    for rate, tolerance in zip(rates, (0.1, 0.03, 0.01, 0.003), strict=True):
        assert rate.expected_error <= tolerance


def test_an_open_scene_takes_the_fewest_rays():
    rate = rays_for_tolerance(builtin_scene("sphere"), BakeSettings(order=6), 1e-4)
    assert rate.rays == 32 and rate.expected_error == 0.0


@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_seconds_are_kept_roughly_and_reported(bumpy, seconds):
    report: dict = {}
    transfer = bake(bumpy, order=4, bounces=1, seconds=seconds, report=report)
    assert report["timings"]["visibility and transfer"] < 3 * seconds
    assert report["timings"]["visibility and transfer"] > 0.1 * seconds
    assert 0 < transfer.certificate["estimated_error"] < 0.05


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"tolerance": math.nan}, "tolerance is nan"),
        ({"tolerance": 1e-9}, "calls for about"),
        ({"seconds": 0}, "seconds is 0"),
        ({"seconds": 1e-9}, "too short"),
        ({"seconds": math.inf}, "seconds is inf"),
        ({"rays": 64, "tolerance": 0.1}, "rays and tolerance were given together"),
        ({"tolerance": 0.1, "seconds": 3}, "tolerance and seconds were given together"),
    ],
)
def test_what_cannot_be_kept_is_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        choose_rays(bumpy, BakeSettings(), **options)
