"""Glossy shading: the law y(view)ᵀ T L, gradients, and bad input."""

import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.shade.glossy import shade_glossy, view_directions
from diffprt.transfer import Receivers
from diffprt.transfer.glossy_signal import GlossyTransfer


def asset(channels: int, dtype: torch.dtype = torch.float64) -> GlossyTransfer:
    generator = torch.Generator().manual_seed(5)
    normals = torch.tensor([[0.0, 0, 1], [0, 1, 0], [0.6, 0, -0.8], [0, 0, -1]], dtype=dtype)
    positions = torch.randn(4, 3, dtype=dtype, generator=generator)
    receivers = Receivers(positions, normals, torch.zeros_like(normals), torch.zeros((0, 3), dtype=torch.int64))
    return GlossyTransfer(torch.randn(4, channels, 16, 9, dtype=dtype, generator=generator), receivers)


@pytest.mark.parametrize("channels", [1, 3])
def test_radiance_is_view_times_transfer_times_light(channels):
    transfer, eye = asset(channels), torch.tensor([3.0, 4.0, 5.0], dtype=torch.float64)
    light = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(6))
    found = shade_glossy(transfer, Light(light), eye)
    for v in (0, 1):
        toward = torch.nn.functional.normalize(eye - transfer.receivers.positions[v], dim=0)
        local = transfer.frames[v].T @ toward
        assert local[2] > 0
        for c in range(3):
            expected = sh.basis(local, 4) @ transfer.glossy[v, c if channels == 3 else 0] @ light[:, c]
            assert float(found[v, c]) == pytest.approx(float(expected), rel=1e-10)


def test_views_from_behind_are_lifted_to_the_horizon():
    """Straight from behind there is no such direction: the result is finite."""
    transfer = asset(1)
    normals, positions = transfer.receivers.normals, transfer.receivers.positions
    behind = view_directions(transfer, positions - normals + 0.1 * transfer.frames[:, :, 0])
    assert torch.allclose(behind, torch.tensor([1.0, 0, 0], dtype=torch.float64).expand(4, 3), atol=1e-12)
    straight = shade_glossy(transfer, torch.ones(9, 3), positions - normals)
    assert torch.isfinite(straight).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients(channels):
    transfer = asset(channels)
    eye = torch.tensor([3.0, 4.0, 5.0], dtype=torch.float64, requires_grad=True)
    light = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(7), requires_grad=True)
    signal = transfer.glossy.clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda t, l, e: shade_glossy(transfer.with_signal(t), l, e), (signal, light, eye))


def test_float32_stays_float32():
    assert (
        shade_glossy(asset(3, torch.float32), torch.ones(9, 3, dtype=torch.float64), (1, 2, 3)).dtype == torch.float32
    )


def test_bad_input_is_named():
    with pytest.raises(InputError, match="project the light with order=3"):
        shade_glossy(asset(1), torch.ones(16, 3), (0.0, 0, 0))
    with pytest.raises(InputError, match=r"eye has shape \[2\]"):
        shade_glossy(asset(1), torch.ones(9, 3), (0.0, 0))
