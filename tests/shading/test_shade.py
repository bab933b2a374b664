"""Shading and tone mapping."""

import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene import Light, constant_light, directional_light
from diffprt.shading import CURVES, shade, srgb_encode, tone_map
from diffprt.surface import Receivers
from diffprt.transfer import Transfer
from diffprt.transfer.diffuse.direct import open_transfer


def open_asset(order: int, albedo: float = 0.8) -> Transfer:
    normals = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(2)), dim=1)
    return Transfer(open_transfer(normals, order).float()[:, None], Receivers.points(normals, normals, albedo))


def test_constant_light_leaves_as_albedo():
    radiance = shade(open_asset(4, 0.3), constant_light((1.0, 2.0, 0.5), 4))
    assert torch.allclose(radiance, 0.3 * torch.tensor([1.0, 2.0, 0.5]).expand(200, 3), atol=FLOAT32["rounding"])


def test_directional_light_gives_the_band_limited_cosine():
    """Hard case 3: irradiance of a directional light to l <= 2 peaks at 1.0625 of the true maximum."""
    asset = open_asset(3, 1.0)
    radiance = shade(asset, directional_light((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), 3)) * math.pi
    cosine = asset.receivers.normals[:, 1]
    expected = 0.25 + cosine / 2 + 5 / 32 * (3 * cosine**2 - 1)
    assert torch.allclose(radiance[:, 0], expected, atol=FLOAT32["twin"])


def test_turning_light_and_receivers_together_changes_nothing(bumpy_transfer):
    axis = torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64)
    turn = torch.linalg.matrix_exp(
        torch.tensor([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    )
    asset = open_asset(5)
    turned_normals = (asset.receivers.normals.double() @ turn.T).float()
    turned = Transfer(open_transfer(turned_normals, 5).float()[:, None], asset.receivers)
    light = Light(torch.randn(25, 3, generator=torch.Generator().manual_seed(1)))
    assert torch.allclose(shade(asset, light), shade(turned, light.rotate(turn.float())), atol=FLOAT32["twin"])


def test_light_of_another_order_is_named(bumpy_transfer):
    with pytest.raises(InputError, match="transfer has 16 SH coefficients, light has 36"):
        shade(bumpy_transfer, torch.zeros(36, 3))


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients(channels, generator):
    signal = torch.randn(5, channels, 4, dtype=torch.float64, generator=generator, requires_grad=True)
    light = torch.randn(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    albedo = torch.rand(5, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    receivers = Receivers.points(torch.rand(5, 3), torch.tensor([[0.0, 1.0, 0.0]]).expand(5, 3))
    assert torch.autograd.gradcheck(lambda s, l, a: shade(Transfer(s, receivers), l, albedo=a), (signal, light, albedo))


@pytest.mark.parametrize("curve", CURVES)
def test_tone_curves_rise_from_black_and_have_gradients(curve):
    x = torch.linspace(0, 4, 200, dtype=torch.float64)[:, None].expand(-1, 3).clone().requires_grad_()
    y = tone_map(x, exposure=0.7, curve=curve)
    assert float(y[0].detach().abs().max()) < 1e-6 and float(y.detach().max()) <= 1
    assert bool((y[1:] >= y[:-1]).all())
    (gradient,) = torch.autograd.grad(y.sum(), x)
    assert bool(torch.isfinite(gradient).all())
    inside = torch.full((2, 3), 0.2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: tone_map(v, curve=curve), inside)
    assert float(tone_map(torch.full((1, 3), -1.0), curve=curve).max()) == 0


def test_srgb_known_values():
    encoded = srgb_encode(torch.tensor([0.0, 0.0031308, 0.18, 0.2140411, 1.0]))
    assert encoded.tolist() == pytest.approx([0, 0.0404499, 0.4613561, 0.5, 1], abs=1e-5)


def test_unknown_curve_is_named():
    with pytest.raises(InputError, match="'film' is unknown"):
        tone_map(torch.zeros(1, 3), curve="film")


def test_shading_float64_stays_float64():
    receivers = Receivers.points(torch.rand(3, 3), torch.tensor([[0.0, 1.0, 0.0]]).expand(3, 3))
    assert (
        shade(Transfer(torch.zeros(3, 1, 4, dtype=torch.float64), receivers), torch.zeros(4, 3)).dtype == torch.float64
    )
    assert sh.clamped_cosine(2, torch.float64).dtype == torch.float64
