"""Inverse lighting: exact on exact pictures, honest about what an object cannot tell."""

import math

import pytest
import torch

from diffprt import sh
from diffprt.brdf import ModifiedPhong
from diffprt.compression import compress, light_prior
from diffprt.errors import InputError
from diffprt.inverse import design_matrix, observe, recover_light
from diffprt.rendering import picture, render
from diffprt.scene import Camera, Light, builtin_environment, builtin_scene
from diffprt.transfer import Transfer, bake, bake_glossy


def views(transfer, count: int = 3, size: int = 64) -> list[Camera]:
    positions = transfer.receivers.positions
    return [
        Camera.framing(positions, azimuth=360 * i / count, elevation=25, width=size, height=size) for i in range(count)
    ]


def photographs(transfer, light: Light, *, noise: float = 0.0, size: int = 64) -> list:
    found = []
    for index, camera in enumerate(views(transfer, size=size)):
        image = render(transfer, light, camera, samples=2)
        level = noise * float(image[image.sum(-1) > 0].square().mean().sqrt())
        deviates = torch.randn(image.shape, generator=torch.Generator().manual_seed(index))
        found.append((image + level * deviates, camera))
    return found


def off(estimate, light: Light) -> float:
    return float((estimate.light.coefficients - light.coefficients).norm() / light.coefficients.norm())


@pytest.fixture(scope="module")
def studio() -> Light:
    return builtin_environment("studio").project(4, window="auto")


def test_the_design_matrix_is_the_picture(bumpy_transfer, studio):
    image, camera = photographs(bumpy_transfer, studio)[0]
    (observation,) = observe(bumpy_transfer.receivers, [(image, camera)])
    design = design_matrix(bumpy_transfer, observation, 4)
    drawn = torch.einsum("nkc,kc->nc", design, studio.coefficients.double())
    assert torch.allclose(drawn, observation.radiance, atol=1e-5 * float(image.max()))
    assert len(drawn) > 500


@pytest.mark.parametrize("kind", ["diffuse", "clustered", "glossy"])
def test_exact_pictures_give_the_light(bumpy, bumpy_transfer, studio, kind):
    asset = bumpy_transfer
    if kind == "clustered":
        asset = compress(bumpy_transfer, clusters=16, components=6)
    elif kind == "glossy":
        asset = bake_glossy(bumpy, ModifiedPhong(16.0), order=4, order_out=4, rays=64, bounces=0)
    found = recover_light(asset, photographs(asset, studio))
    assert found.observable == (True,) * 4
    assert off(found, studio) < 1e-3 and found.residual < 1e-4


def test_another_bake_with_noise_gives_it_too(bumpy, bumpy_transfer, studio):
    """128 rays per receiver see what 512 of another seed have drawn, with 1 % noise."""
    other = bake(bumpy, order=4, rays=512, bounces=1, seed=5)
    found = recover_light(bumpy_transfer, photographs(other, studio, noise=0.01))
    assert off(found, studio) < 0.03
    band = sh.band_of_index(4)
    errors = found.light.coefficients - studio.coefficients
    share = torch.tensor([float(errors[band == l].norm() / studio.coefficients.norm()) for l in range(4)])
    # Standard errors: within three of them, with 3 to 21 coefficients a band.
    assert bool((share < 3 * torch.tensor(found.standard_error)).all())
    assert 0.009 < found.residual < 0.03


def test_a_convex_object_cannot_see_bands_3_and_5():
    """Unit sphere, matt, nothing shadowed: t_3 = t_5 = 0, and the gains of the others go as t_l."""
    sphere = bake(builtin_scene("sphere", subdivisions=4), order=6, rays=16, bounces=0)
    light = builtin_environment("studio").project(6, window="auto")
    found = recover_light(sphere, photographs(sphere, light))
    assert found.observable == (True, True, True, False, True, False)
    assert max(found.gain[3], found.gain[5]) < 1e-4 < 1e-2 < found.gain[4]
    assert found.standard_error[3] == found.standard_error[5] == math.inf
    band = sh.band_of_index(6)
    hidden = (band == 3) | (band == 5)
    assert float(found.light.coefficients[hidden].abs().max()) == 0
    seen = (found.light.coefficients - light.coefficients)[~hidden]
    assert float(seen.norm() / light.coefficients.norm()) < 2e-3
    prior = light_prior([builtin_environment("sky").project(6).coefficients])
    tamed = recover_light(sphere, photographs(sphere, light), prior=prior)
    assert float(tamed.light.coefficients[hidden].norm()) < 0.01 * float(light.coefficients.norm())


def test_a_prior_finds_a_light_where_pictures_alone_do_not(bumpy_transfer, studio):
    """One small noisy picture."""
    pictures = photographs(bumpy_transfer, studio, noise=0.1, size=32)[:1]
    with pytest.raises(InputError, match="give more of them, or a prior"):
        recover_light(bumpy_transfer, pictures)
    found = recover_light(bumpy_transfer, pictures, prior=light_prior([studio.coefficients]))
    assert off(found, studio) < 0.5


def test_lower_orders_are_the_low_bands(bumpy_transfer, studio):
    low = Light(torch.cat([studio.coefficients[:4], torch.zeros(12, 3)]))
    found = recover_light(bumpy_transfer, photographs(bumpy_transfer, low), order=2)
    assert found.light.order == 2
    assert torch.allclose(found.light.coefficients, low.coefficients[:4], atol=1e-3 * float(low.coefficients.norm()))


def test_bad_pictures_are_named(bumpy_transfer, studio):
    (image, camera), *_ = photographs(bumpy_transfer, studio)
    broken = image.clone()
    broken[3, 5] = math.nan
    away = Camera((0.0, 0.0, 9.0), (0.0, 0.0, 20.0), width=64, height=64)
    small = Camera.framing(bumpy_transfer.receivers.positions, width=3, height=3)
    cases = [
        ([], "there are no references"),
        ([(broken, camera)], "reference 0: 1 of 4096 pixels are not finite"),
        ([(image, camera), (torch.zeros_like(image), camera)], "reference 1: the picture is black"),
        ([(image[1:], camera)], r"reference 0: the picture is \[63, 64, 3\], its camera 64 x 64"),
        ([(image, away)], "reference 0: the camera at .* sees none"),
        ([(image[:3, :3], small)], "reference 0: 0 pixels lie inside the object's outline"),
    ]
    for pictures, message in cases:
        with pytest.raises(InputError, match=message):
            recover_light(bumpy_transfer, pictures)
    with pytest.raises(InputError, match="order is 5: the asset tells 1 to 4 bands"):
        recover_light(bumpy_transfer, [(image, camera)], order=5)
    with pytest.raises(InputError, match="sends nothing in some color under any light"):
        recover_light(bumpy_transfer.with_signal(torch.zeros_like(bumpy_transfer.diffuse)), [(image, camera)])


def test_gradient_descent_agrees(bumpy_transfer, studio):
    """The least squares estimate is where the gradient of the picture's error vanishes."""
    pictures = photographs(bumpy_transfer, studio, noise=0.05)
    found = recover_light(bumpy_transfer, pictures)
    coefficients = found.light.coefficients.double().requires_grad_()
    asset = Transfer(bumpy_transfer.diffuse.double(), bumpy_transfer.receivers)
    loss, scale = 0.0, 0.0
    for o in observe(asset.receivers, pictures):
        drawn = picture(asset, coefficients, o.frozen)[o.frozen.mask][o.rows]
        loss = loss + (drawn - o.radiance).square().sum()
        scale += float(o.radiance.square().sum())
    (gradient,) = torch.autograd.grad(loss, coefficients)
    assert float(gradient.norm() * found.light.coefficients.norm()) < 1e-4 * scale
