"""`tolerance` and `seconds`: the chosen rays deliver the error that was asked for, and say so honestly."""

import itertools
import math
from dataclasses import replace

import pytest
import torch
from tolerances import FLOAT32, relative_error

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh
from diffprt.options.bake import BakeSettings
from diffprt.scene import Scene, builtin_scene
from diffprt.surface import Surfaces
from diffprt.surface.sampling import Pattern
from diffprt.transfer import bake, prepare, rays_for_tolerance
from diffprt.transfer.diffuse.picked import reflected_light, some_receivers, trace_some


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
    "bowl": lambda: builtin_scene("bowl", subdivisions=1),
    "cornell": lambda: builtin_scene("cornell", subdivisions=3),
    "blob 1": lambda: random_blob(1),
    "blob 2": lambda: random_blob(2),
}


@pytest.mark.parametrize("name", list(SCENES))
def test_tolerance_is_met_at_no_more_than_twice_the_cost(name, bumpy):
    scene = bumpy if name == "bumpy" else SCENES[name]()
    tolerance = 0.03
    report: dict = {}
    rough = bake(scene, order=4, bounces=1, tolerance=tolerance, report=report)
    rays = report["settings"]["rays"]
    fine = bake(scene, order=4, bounces=1, rays=16 * rays, seed=7)
    error = relative_error(rough.diffuse, fine.diffuse)
    assert error <= tolerance
    # Both are meant as bounds, two standard errors above what trials found; the finer bake has noise of its own.
    for name in ("expected_error", "estimated_error"):
        estimate = rough.certificate[name]
        assert error < 1.05 * estimate and estimate < 1.6 * error, f"{name} is honest"
    # The error falls like N^-3/4: half the rays would leave 1.68 times of it.
    best = rays * (error / tolerance) ** (4 / 3)
    spent = rays + report["sampling"]["pilot_rays"] / len(rough.receivers)
    small = len(rough.receivers) < 2000
    assert spent < (2.5 if small else 2.0) * best, "on a small mesh the trials weigh more"


def test_forecast_holds_over_seeds(bumpy):
    """One truth, many samples of receivers: hardly any of them may lead to an error above what was asked."""
    settings = BakeSettings(order=3, bounces=0)
    fine = bake(bumpy, order=3, bounces=0, rays=4096, seed=1000).diffuse
    missed = 0
    for seed in range(12):
        rate = rays_for_tolerance(bumpy, replace(settings, seed=seed), 0.03)
        rough = bake(bumpy, order=3, bounces=0, rays=rate.rays, seed=seed).diffuse
        missed += relative_error(rough, fine) > 0.03
    assert missed == 0


def test_interreflection_needs_fewer_rays():
    """In a bowl it adds a third to the signal and little noise; a forecast from direct light would ask too many."""
    bowl = builtin_scene("bowl", subdivisions=1)
    direct, whole = (rays_for_tolerance(bowl, BakeSettings(order=4, bounces=n), 0.02) for n in (0, 4))
    assert whole.rays < 0.9 * direct.rays
    fine = bake(bowl, order=4, bounces=4, rays=16 * whole.rays, seed=7).diffuse
    rough = bake(bowl, order=4, bounces=4, rays=whole.rays).diffuse
    assert 0.014 < relative_error(rough, fine) <= 0.02


def test_trials_see_what_a_bake_sees():
    """The sample's traces start where those of a bake do, and gather what it gathers, to the noise of their rays."""
    surfaces = Surfaces.of(builtin_scene("cornell", subdivisions=2))
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    every = surfaces.receivers
    pick = torch.arange(0, len(every), 3)
    some = some_receivers(every, pick, mesh.ray_offset())
    whole, part = every.origins(mesh.ray_offset())[pick], some.origins(mesh.ray_offset())
    assert torch.allclose(whole, part, atol=FLOAT32["rounding"])
    scene = builtin_scene("cornell", subdivisions=2)
    before, after = (bake(scene, order=3, bounces=n, rays=4096, seed=n, fill_inside=False).diffuse for n in (1, 2))
    pattern = Pattern.create(4096, surfaces.scramble(some, 9))
    found, noise = trace_some(surfaces, mesh, some, pattern, 3, reflected=reflected_light(surfaces, before))
    assert found.shape == after[pick].shape and noise.shape == (len(pick), 1, 9)
    assert relative_error(found, after[pick]) < 0.01
    assert relative_error(found, before[pick]) > 0.02


@pytest.mark.parametrize("bounces", [0, 2])
def test_tolerance_is_the_same_for_any_thread_count(bumpy, bounces):
    settings = BakeSettings(order=3, bounces=bounces)
    one, four = (rays_for_tolerance(bumpy, settings, 0.02, threads=n) for n in (1, 4))
    assert one == four


def test_smaller_tolerances_take_more_rays(bumpy):
    settings = BakeSettings(order=3, bounces=0)
    rates = [rays_for_tolerance(bumpy, settings, t) for t in (0.1, 0.03, 0.01, 0.003)]
    assert all(a.rays < b.rays for a, b in itertools.pairwise(rates))
    for rate, tolerance in zip(rates, (0.1, 0.03, 0.01, 0.003), strict=True):
        assert rate.expected_error <= tolerance


@pytest.mark.parametrize("bounces", [0, 2])
def test_an_open_scene_takes_the_fewest_rays(bounces):
    rate = rays_for_tolerance(builtin_scene("sphere"), BakeSettings(order=6, bounces=bounces), 1e-4)
    assert rate.rays == 32 and rate.expected_error == 0.0
    assert rate.pilot_rays == 2 * 32 * round(2562 ** (2 / 3)), "one trial of V^(2/3) receivers, of 2562, settles it"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"tolerance": math.nan}, "tolerance is nan"),
        ({"tolerance": 1e-9}, "calls for about"),
        ({"seconds": 0}, "seconds is 0"),
        ({"seconds": math.inf}, "seconds is inf"),
        ({"rays": 64, "tolerance": 0.1}, "rays and tolerance were given together"),
        ({"tolerance": 0.1, "seconds": 3}, "tolerance and seconds were given together"),
    ],
)
def test_what_cannot_be_kept_is_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        _ = prepare(bumpy, **options).settings
