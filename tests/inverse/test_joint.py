"""Light and albedo together: told apart by two lights or by groups, refused where they cannot be."""

import math

import pytest
import torch

from diffprt.errors import InputError
from diffprt.inverse import recover_light_and_albedo
from diffprt.inverse.factor import factored_lights
from diffprt.rendering import render
from diffprt.scene import Camera, Light, builtin_environment
from diffprt.transfer import trace


@pytest.fixture(scope="module")
def transport(bumpy):
    return trace(bumpy, order=3, rays=128, bounces=2)


@pytest.fixture(scope="module")
def lights() -> list[Light]:
    turn = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))
    studio = builtin_environment("studio").project(3, window="auto")
    return [builtin_environment("sky").project(3, window="auto"), studio, studio.rotate(turn)]


def painted(positions: torch.Tensor) -> torch.Tensor:
    x, y, z = positions.T
    return torch.stack([0.5 + 0.2 * (3 * x).sin(), 0.4 + 0.2 * (2 * y + z).cos(), 0.6 + 0.2 * (2 * z).sin()], dim=1)


def photographs(transfer, lights: list[Light], count: int = 4) -> tuple[list, list[int]]:
    positions = transfer.receivers.positions
    cameras = [
        Camera.framing(positions, azimuth=360 * i / count, elevation=(-40, 40)[i % 2], width=64, height=64)
        for i in range(count)
    ]
    pictures = [(render(transfer, light, camera, samples=2), camera) for light in lights for camera in cameras]
    return pictures, [index for index in range(len(lights)) for _ in cameras]


def light_errors(found, lights: list[Light]) -> list[float]:
    return [
        float((one.light.coefficients - light.coefficients).norm() / light.coefficients.norm())
        for one, light in zip(found.lights, lights, strict=True)
    ]


def albedo_error(found, truth: torch.Tensor) -> float:
    told = found.albedo.told.amin(1) > 0.5
    return float((found.albedo.albedo - truth)[told].norm() / truth[told].norm())


def test_the_closed_form_is_exact_on_exact_data(generator):
    """Random transfer: lights up to their common scale, albedo up to its mean."""
    signal = torch.randn(200, 9, generator=generator, dtype=torch.float64) * 0.3
    signal[:, 0] += 2.0
    truth = 0.2 + 0.6 * torch.rand(200, generator=generator, dtype=torch.float64)
    lights = torch.randn(2, 9, generator=generator, dtype=torch.float64) * 0.3
    lights[:, 0] += 2.0
    sent = truth * (lights @ signal.T) / math.pi
    found, albedo, best, following = factored_lights(signal, sent, torch.ones_like(sent), torch.arange(200))
    assert torch.allclose(found / found.norm(), lights / lights.norm(), atol=1e-8)
    assert torch.allclose(albedo, truth / truth.mean(), atol=1e-8)
    assert best < 1e-6 and following > 0.01


def test_three_lights_tell_light_from_albedo(transport, lights):
    truth = painted(transport.receivers.positions)
    pictures, lit_by = photographs(transport.transfer(albedo=truth), lights)
    found = recover_light_and_albedo(transport, pictures, lit_by=lit_by, mean_albedo=truth.mean(0), noise=1e-3)
    assert albedo_error(found, truth) < 0.03 and max(light_errors(found, lights)) < 0.05
    assert found.next_best > 2 * found.mismatch


def test_groups_tell_them_apart_under_one_light(transport, lights):
    groups = (transport.receivers.positions * 2).floor().sum(1).long() % 3
    truth = torch.tensor([[0.3, 0.6, 0.5], [0.7, 0.4, 0.2], [0.5, 0.5, 0.8]])[groups]
    pictures, _ = photographs(transport.transfer(albedo=truth), lights[:1])
    patch = (groups == 1).nonzero()[:, 0]
    options = {"groups": groups, "mean_albedo": truth[patch[0]], "patch": patch}
    found = recover_light_and_albedo(transport, pictures, **options)
    assert albedo_error(found, truth) < 0.01 and light_errors(found, lights[:1])[0] < 0.02
    transfer = transport.transfer(0)
    means = (truth[patch[0]], truth[patch[0]] / 2)
    scaled = (recover_light_and_albedo(transfer, pictures, **{**options, "mean_albedo": mean}) for mean in means)
    brighter, darker = (one.lights[0].light.coefficients for one in scaled)
    assert float((darker - 2 * brighter).norm()) < 1e-3 * float(darker.norm())


def test_what_cannot_be_told_is_refused(transport, lights):
    transfer = transport.transfer(0)
    pictures, _ = photographs(transfer, lights[:1], count=2)
    with pytest.raises(InputError, match="one light and an albedo for every receiver explain any picture"):
        recover_light_and_albedo(transfer, pictures)
    with pytest.raises(InputError, match="do not tell light from albedo"):
        recover_light_and_albedo(transfer, pictures + pictures, lit_by=[0, 0, 1, 1])
    with pytest.raises(InputError, match="lit_by has 1 entries for 2 pictures"):
        recover_light_and_albedo(transfer, pictures, lit_by=[0])
    with pytest.raises(InputError, match="mean_albedo is"):
        recover_light_and_albedo(transfer, pictures, lit_by=[0, 1], mean_albedo=0.0)
