"""Glossy shading: the law y(view)ᵀ T L, gradients, and bad input."""

import pytest
import torch
from tolerances import FLOAT64

from diffprt import sh
from diffprt.compression import ClusteredGlossyTransfer
from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer.glossy.signal import GlossyTransfer


def asset(channels: int, dtype: torch.dtype = torch.float64) -> GlossyTransfer:
    generator = torch.Generator().manual_seed(5)
    normals = torch.tensor([[0.0, 0, 1], [0, 1, 0], [0.6, 0, -0.8], [0, 0, -1]], dtype=dtype)
    positions = torch.randn(4, 3, dtype=dtype, generator=generator)
    receivers = Receivers(positions, normals, torch.zeros_like(normals), torch.zeros((0, 3), dtype=torch.int64))
    return GlossyTransfer(torch.randn(4, channels, 16, 9, dtype=dtype, generator=generator), receivers)


def clustered(
    channels: int, dtype: torch.dtype = torch.float64, count: int = 4, shape: tuple[int, int] = (16, 9)
) -> ClusteredGlossyTransfer:
    """Three clusters with two components each; `shape` is [K_out, K]."""
    generator = torch.Generator().manual_seed(8)
    points = torch.randn(count, 3, generator=generator)
    return ClusteredGlossyTransfer(
        torch.arange(count) * 7 % 3,
        torch.randn(3, channels, *shape, dtype=dtype, generator=generator),
        torch.randn(3, 2, channels, *shape, dtype=dtype, generator=generator),
        torch.randn(count, 2, dtype=dtype, generator=generator),
        Receivers.points(points, points),
    )


@pytest.mark.parametrize("channels", [1, 3])
def test_radiance_is_view_times_transfer_times_light(channels):
    transfer, eye = asset(channels), torch.tensor([3.0, 4.0, 5.0], dtype=torch.float64)
    light = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(6))
    found = shade(transfer, Light(light), eye)
    for v in (0, 1):
        toward = torch.nn.functional.normalize(eye - transfer.receivers.positions[v], dim=0)
        local = transfer.frames[v].T @ toward
        assert local[2] > 0
        for c in range(3):
            expected = sh.basis(local, 4) @ transfer.glossy[v, c if channels == 3 else 0] @ light[:, c]
            assert float(found[v, c]) == pytest.approx(float(expected), rel=FLOAT64["twin"])


def test_views_from_behind_are_lifted_to_the_horizon():
    """Straight from behind there is no such direction: the result is finite."""
    transfer = asset(1)
    normals, positions = transfer.receivers.normals, transfer.receivers.positions
    tangent = transfer.frames[:, :, 0]
    behind = shade(transfer, torch.ones(9, 3), positions - normals + 0.1 * tangent)
    along = shade(transfer, torch.ones(9, 3), positions + tangent)
    assert torch.allclose(behind, along, rtol=0, atol=FLOAT64["rounding"] * float(along.abs().max()))
    straight = shade(transfer, torch.ones(9, 3), positions - normals)
    assert torch.isfinite(straight).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients(channels):
    transfer = asset(channels)
    eye = torch.tensor([3.0, 4.0, 5.0], dtype=torch.float64, requires_grad=True)
    light = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(7), requires_grad=True)
    signal = transfer.glossy.clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda t, l, e: shade(transfer.with_signal(t), l, e), (signal, light, eye))


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
@pytest.mark.parametrize("channels", [1, 3])
def test_clusters_under_the_light_then_blended_are_the_decoded_transfer(channels, dtype, tolerance):
    """Hard case 19, for whole exit radiance, by mirrored direction, and towards the eye."""
    compressed = clustered(channels, dtype, count=200)
    light = torch.randn(9, 3, dtype=dtype, generator=torch.Generator().manual_seed(9))
    eye = torch.tensor([3.0, 4.0, 5.0])
    decoded = compressed.decode()
    assert decoded.glossy.dtype == dtype
    looks = (
        lambda asset: asset.exit_radiance(light),
        lambda asset: asset.lit(light).coefficients,
        lambda asset: shade(asset, light, eye),
    )
    for look in looks:
        found, expected = look(compressed), look(decoded)
        assert found.dtype == dtype
        assert float((found - expected).abs().max()) < tolerance * float(expected.square().mean().sqrt())


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients_of_clustered_shading(channels):
    compressed = clustered(channels, shape=(4, 4))
    generator = torch.Generator().manual_seed(10)
    light = torch.randn(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    parameters = [t.clone().requires_grad_() for t in (compressed.means, compressed.bases, compressed.weights)]

    def made(*parameters):
        return ClusteredGlossyTransfer(compressed.labels, *parameters, compressed.receivers)

    def seen(light, *parameters):
        return made(*parameters).exit_radiance(light), shade(made(*parameters), light, (3.0, 4, 5))

    assert torch.autograd.gradcheck(seen, [light, *parameters])
    gradients = torch.autograd.grad(made(*parameters).lit(light).coefficients.square().sum(), [light, *parameters])
    decoded = made(*parameters).decode()
    expected = torch.autograd.grad(decoded.lit(light).coefficients.square().sum(), [light, *parameters])
    for one, two in zip(gradients, expected, strict=True):
        assert torch.allclose(one, two, rtol=FLOAT64["twin"], atol=FLOAT64["twin"] * float(two.abs().max()))


def test_names_of_clusters_and_signs_of_components_change_nothing():
    """Hard case 18."""
    one = clustered(1)
    turned = torch.tensor([2, 0, 1])  # cluster m becomes turned[m]
    back = turned.argsort()
    two = ClusteredGlossyTransfer(turned[one.labels], one.means[back], -one.bases[back], -one.weights, one.receivers)
    light = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(11))
    assert torch.allclose(one.exit_radiance(light), two.exit_radiance(light), rtol=0, atol=FLOAT64["rounding"])


def test_float32_stays_float32():
    assert shade(asset(3, torch.float32), torch.ones(9, 3, dtype=torch.float64), (1, 2, 3)).dtype == torch.float32


def test_bad_input_is_named():
    with pytest.raises(InputError, match="project the light with order=3"):
        shade(asset(1), torch.ones(16, 3), (0.0, 0, 0))
    with pytest.raises(InputError, match=r"eye has shape \[2\]"):
        shade(asset(1), torch.ones(9, 3), (0.0, 0))
    for transfer in (asset(1), clustered(1)):
        with pytest.raises(InputError, match="transfer has 9 SH coefficients, light has 16"):
            shade(transfer, torch.ones(16, 3), (0.0, 0, 0))
        with pytest.raises(InputError, match=r"light has shape \[9\]: give SH coefficients of RGB, \[9, 3\]"):
            shade(transfer, torch.ones(9), (0.0, 0, 0))
        with pytest.raises(InputError, match="a glossy asset looks different from everywhere"):
            shade(transfer, torch.ones(9, 3))
        with pytest.raises(InputError, match="leave albedo out"):
            shade(transfer, torch.ones(9, 3), (0.0, 0, 0), albedo=torch.ones(4, 3))
