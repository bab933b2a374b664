"""Batches of lights: the pictures and values of one by one, with the same gradients, for every kind of asset."""

import math

import pytest
import representations as kinds
import torch

from diffprt import Light, render, shade
from diffprt.errors import InputError
from diffprt.rendering import FrozenView, picture
from diffprt.scene import Camera

EYE = (0.5, 1.0, 3.0)
KINDS = list(kinds.REPRESENTATIONS)
DISTANT = [name for name in KINDS if name != "irradiance_vectors"]
COUNT = 10  # more than are held at a time


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    return request.param


def made(kind):
    case = kinds.REPRESENTATIONS[kind]
    asset = case.make()
    camera = Camera.framing(asset.elements.positions, azimuth=25, width=24, height=20)
    return asset, [case.lights(math.cos(i), 0.3 + i) for i in range(COUNT)], camera


def close(batch, one_by_one):
    alone = torch.stack(one_by_one)
    assert batch.shape == alone.shape and bool(batch.any())
    assert float((batch - alone).abs().max()) <= 1e-6 * float(alone.abs().max())


def test_a_list_is_each_light_alone(kind):
    asset, lights, camera = made(kind)
    close(shade(asset, lights, EYE), [shade(asset, light, EYE) for light in lights])
    close(render(asset, lights, camera, samples=2), [render(asset, light, camera, samples=2) for light in lights])
    frozen = FrozenView.of(asset.elements, camera)
    close(picture(asset, lights, frozen), [picture(asset, light, frozen) for light in lights])
    assert torch.equal(shade(asset, lights[:1], EYE)[0], shade(asset, tuple(lights[:1]), EYE)[0])


@pytest.mark.parametrize("kind", DISTANT)
def test_coefficients_are_a_batch_and_backgrounds_are_their_own(kind):
    asset, lights, camera = made(kind)
    batch = torch.stack([light.coefficients for light in lights])
    assert torch.equal(shade(asset, batch, EYE), shade(asset, lights, EYE))
    for background in ("light", (0.1, 0.2, 0.3), 0.4):
        found = render(asset, batch, camera, background=background)
        close(found, [render(asset, light, camera, background=background) for light in lights])


@pytest.mark.parametrize("kind", DISTANT)
@pytest.mark.parametrize("draw", ["shade", "render"])
def test_gradients_reach_every_light(kind, draw):
    asset, lights, camera = made(kind)
    asset = asset.to(torch.float64)
    batch = torch.stack([light.coefficients for light in lights[:3]]).double()
    weight = torch.rand(3, *((len(asset.elements),) if draw == "shade" else (20, 24)), 3, dtype=torch.float64)

    def drawn(light):
        return shade(asset, light, EYE) if draw == "shade" else render(asset, light, camera)

    together = batch.clone().requires_grad_(True)
    (drawn(together) * weight).sum().backward()
    for light, factor, found in zip(batch, weight, together.grad, strict=True):
        alone = light.clone().requires_grad_(True)
        (drawn(alone) * factor).sum().backward()
        assert torch.allclose(found, alone.grad, rtol=1e-9, atol=1e-12) and bool(found.any())


def test_an_albedo_is_that_of_all_of_them():
    asset, lights, camera = made("transfer")
    albedo = torch.rand(len(asset.elements), 3)
    for given in (albedo, albedo[:, :1], albedo[0]):
        found = shade(asset, lights, albedo=given)
        close(found, [shade(asset, light, albedo=given) for light in lights])
    frozen = FrozenView.of(asset.elements, camera)
    found = picture(asset, lights, frozen, albedo=albedo)
    close(found, [picture(asset, light, frozen, albedo=albedo) for light in lights])


@pytest.mark.parametrize("kind", ["clustered_transfer", "clustered_glossy_transfer"])
def test_the_scene_is_rasterized_once(kind, monkeypatch):
    asset, lights, camera = made(kind)
    seen = []
    own = type(asset.elements).view
    monkeypatch.setattr(
        type(asset.elements), "view", lambda self, *given, **named: seen.append(1) or own(self, *given, **named)
    )
    render(asset, lights, camera)
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("lights", "message"),
    [
        ([], "batch of lights is empty"),
        (torch.zeros(0, 9, 3), "batch of lights is empty"),
        (torch.zeros(2, 9, 4), r"light 1 of 2: light has shape \[9, 4\]"),
        (torch.zeros(2, 16, 3), "light 1 of 2: transfer has 9 SH coefficients, light has 16"),
        ([Light(torch.ones(9, 3)), torch.ones(4, 3)], "light 2 of 2: transfer has 9"),
        ([Light(torch.ones(9, 3)), "sky"], r"light 2 of 2: light is a str: give a Light.*project\(3\)"),
        ("sky", "light is a str"),
        (torch.zeros(1, 2, 9, 3), r"shape \[1, 2, 9, 3\]"),
    ],
)
def test_what_is_no_batch_is_refused_in_one_line(lights, message):
    asset, _, camera = made("transfer")
    for draw in (lambda: shade(asset, lights), lambda: render(asset, lights, camera)):
        with pytest.raises(InputError, match=message) as caught:
            draw()
        assert "\n" not in str(caught.value)
