"""The window that errs least in the picture, against what an asset of order 10 says."""

from dataclasses import replace

import pytest
import torch

from diffprt import bake, sh
from diffprt.brdf import Phong
from diffprt.errors import InputError
from diffprt.rendering import PictureWindow, clipped_share, render, view_exposure
from diffprt.rendering.picture_rows import most_answered, picture_rows
from diffprt.rendering.picture_window import CHOICES, _sphere, extended
from diffprt.scene import Camera, Environment, Light, builtin_environment, builtin_scene
from diffprt.shading import tone_map

ORDER = 4
SCENES = {
    "ball on ground": builtin_scene("sphere", subdivisions=2).with_ground(resolution=12),
    "cornell": builtin_scene("cornell", subdivisions=2),
    "bowl": builtin_scene("bowl", subdivisions=0).with_ground(resolution=12),
}


def small_sun() -> Environment:
    """A sun of eight texels low in the front, in a faint sky."""
    image = torch.full((16, 32, 3), 0.2)
    image[5:7, 14:18] = 60.0
    return Environment(image, "small sun")


MAPS = {"sky": builtin_environment("sky"), "studio": builtin_environment("studio"), "small sun": small_sun()}


@pytest.fixture(scope="module")
def assets():
    made = {}
    for name, scene in SCENES.items():
        made[name] = [bake(scene, order=order, rays=256, bounces=1) for order in (ORDER, 10)]
    return made


@pytest.fixture(scope="module")
def projected():
    return {name: sh.project_map(environment.image, 10) for name, environment in MAPS.items()}


def light_of(coefficients: torch.Tensor, window: str) -> Light:
    factors = sh.window(window, ORDER)[sh.band_of_index(ORDER)].to(coefficients)
    report = {"environment": "map", "window": window}
    return Light(factors[:, None] * coefficients[: ORDER**2], report)


def chosen_light(asset, camera: Camera, coefficients: torch.Tensor) -> Light:
    errors = PictureWindow.of(asset, camera).errors(coefficients)
    return light_of(coefficients, min(errors, key=errors.__getitem__))


def camera_of(asset) -> Camera:
    return Camera.framing(asset.elements.subject, width=48, height=48)


@pytest.mark.parametrize("map_name", MAPS)
@pytest.mark.parametrize("name", SCENES)
def test_the_picture_errs_about_as_little_as_with_the_best_fixed_window(name, map_name, assets, projected):
    asset, full = assets[name]
    coefficients, camera = projected[map_name], camera_of(asset)
    truth = render(full, Light(coefficients), camera).clamp_min(0)

    def error(light) -> float:
        return float((render(asset, light, camera).clamp_min(0) - truth).square().mean().sqrt())

    fixed = {window: error(light_of(coefficients, window)) for window in CHOICES}
    assert error(chosen_light(asset, camera, coefficients)) <= 1.1 * min(fixed.values())


def test_some_pictures_want_a_window_and_others_none(assets):
    for name, map_name, wanted in (("ball on ground", "studio", {"none"}), ("cornell", "sky", {"lanczos", "hann"})):
        asset = assets[name][0]
        light = PictureWindow.of(asset, camera_of(asset)).project(MAPS[map_name])
        assert light.report["window"] in wanted
        expected = MAPS[map_name].project(ORDER, window=light.report["window"])
        assert torch.equal(light.coefficients, expected.coefficients)


def test_a_turned_light_is_judged_as_it_is_turned(assets):
    asset = assets["cornell"][0]
    window = PictureWindow.of(asset, camera_of(asset))
    turn = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    rolled = Environment(MAPS["small sun"].image.roll(8, dims=1), "small sun")
    for turned in (turn, turn.T):
        one, other = window.project(MAPS["small sun"], turned), window.project(rolled)
        if torch.allclose(one.coefficients, other.coefficients, atol=1e-3):
            assert one.report["expected_errors"] == pytest.approx(other.report["expected_errors"], rel=1e-3)
            return
    pytest.fail("no quarter turn of the light is that of its map")


def test_answers_are_extended_by_what_makes_them_positive_and_their_bands_are_kept(assets):
    small, full = assets["ball on ground"]
    asset_rows = small.diffuse[:, 0].double()
    beyond = extended(asset_rows, 10)
    assert torch.equal(beyond[:, : ORDER**2], asset_rows)
    truth = full.diffuse[:, 0].double()[:, ORDER**2 :]
    assert (beyond[:, ORDER**2 :] - truth).norm() < 0.8 * truth.norm()


def test_answers_stay_below_what_an_open_surface_gives(assets):
    """In a box the bound brings the guess nearer to the truth, and the sun behind its walls to the strong window."""
    small, full = assets["cornell"]
    camera = camera_of(small)
    found, truth = picture_rows(small, camera), picture_rows(full, camera)
    most = most_answered(found.part, found.seen, _sphere()[0])
    assert most is not None and most.shape == (len(found.rows), len(_sphere()[0])) and float(most.min()) >= 0
    beyond = slice(ORDER**2, None)
    bounded, free = (extended(found.rows, 10, bound)[:, beyond] for bound in (most, None))
    wanted = truth.rows[:, beyond]
    assert (bounded - wanted).norm() < 0.97 * (free - wanted).norm()
    glossy = bake(SCENES["cornell"].with_brdf(Phong(8)), order=2, rays=32)
    part = picture_rows(glossy, camera)
    assert most_answered(part.part, part.seen, _sphere()[0]) is None, "a highlight may exceed it"


def test_picture_is_refused_by_name_where_there_is_no_asset():
    with pytest.raises(InputError, match="window 'picture' depends on the asset"):
        builtin_environment("sky").project(3, window="picture")


def test_what_is_clipped_is_a_share_of_what_is_positive():
    image = torch.tensor([[[2.0, -1.0, 0.0], [3.0, -9.0, 9.0]]])
    assert clipped_share(image, torch.tensor([[True, False]])) == 0.5
    assert clipped_share(image, torch.zeros(1, 2, dtype=torch.bool)) == 0.0


@pytest.mark.parametrize("curve", ["linear", "reinhard", "aces"])
@pytest.mark.parametrize("map_name", MAPS)
@pytest.mark.parametrize("name", SCENES)
def test_the_sky_is_below_white_from_every_side(name, map_name, curve, assets, projected):
    asset, camera = assets[name][0], camera_of(assets[name][0])
    light = chosen_light(asset, camera, projected[map_name])
    factor = view_exposure(asset, light, camera, curve=curve)
    for azimuth in range(0, 360, 120):
        around = replace(Camera.framing(asset.elements.subject, azimuth=azimuth, elevation=30, width=32, height=32))
        image = render(asset, light, around, background="light")
        sky = tone_map(image, exposure=factor, curve=curve)[~asset.elements.view(around).mask]
        assert len(sky) and float(sky.max()) < 1.0


def test_a_sky_that_is_not_seen_darkens_nothing(assets, projected):
    """Inside a box, what the sky would take is six times the exposure."""
    asset, camera = assets["cornell"][0], camera_of(assets["cornell"][0])
    light = chosen_light(asset, camera, projected[next(iter(MAPS))])
    shown = view_exposure(asset, light, camera, curve="aces")
    alone = view_exposure(asset, light, camera, curve="aces", sky=False)
    assert alone > 1.5 * shown
    several = view_exposure(asset, [light, light], camera, curve="aces")
    assert several == pytest.approx(shown)
