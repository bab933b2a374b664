import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.errors import InputError

T = (0.886227, 1.023327, 0.495416, 0.0, -0.110778, 0.0, 0.049927)


def zonal_by_quadrature(function, order: int, edge: float) -> torch.Tensor:
    """∫ f(z) y_l0 with Gauss nodes on both sides of the edge z = `edge`, where f is not smooth."""
    nodes, weights = sh.sphere_quadrature(60)  # only its z is used: first node of each ring
    nodes, weights = nodes[::61, 2], weights[::61] * 61 / (2 * math.pi)
    total = torch.zeros(order, dtype=torch.float64)
    for low, high in ((-1.0, edge), (edge, 1.0)):
        z = low + (high - low) * (nodes + 1) / 2
        directions = torch.stack([(1 - z * z).clamp_min(0).sqrt(), torch.zeros_like(z), z], dim=-1)
        bands = torch.arange(order)
        values = sh.basis(directions, order)[:, bands * (bands + 1)]
        total += math.pi * (high - low) * ((function(z) * weights)[:, None] * values).sum(0)
    return total


def test_clamped_cosine_has_the_known_coefficients(dtype):
    assert torch.allclose(sh.clamped_cosine(7, dtype), torch.tensor(T, dtype=dtype), atol=5e-7)
    assert sh.clamped_cosine(7, dtype).dtype == dtype


def test_clamped_cosine_by_quadrature():
    expected = zonal_by_quadrature(lambda z: z.clamp_min(0), 10, 0.0)
    assert torch.allclose(sh.clamped_cosine(10), expected, atol=1e-13)


def test_clamped_cosine_energy_by_band():
    share = sh.clamped_cosine(5).square().cumsum(0) / (2 * math.pi / 3)
    assert torch.allclose(share * 100, torch.tensor([37.5, 87.5, 99.219, 99.219, 99.805]).double(), atol=5e-4)


@pytest.mark.parametrize("half_angle", [1e-6, 0.00465, 0.3, math.pi / 2, 2.5, math.pi])
def test_cap_by_quadrature(half_angle):
    zonal = sh.cap(half_angle, 10)
    edge = math.cos(half_angle)
    expected = zonal_by_quadrature(lambda z: (z > edge).double(), 10, edge)
    # The reference forms 1 - cos α, which cancels in small caps; relative to the solid angle below.
    solid_angle = 4 * math.pi * math.sin(half_angle / 2) ** 2
    rounding = 1e-13 + 1e-15 / solid_angle
    assert ((zonal - expected).abs() / solid_angle).max() < rounding
    assert zonal[0].item() == pytest.approx(solid_angle / math.sqrt(4 * math.pi), rel=1e-14)


def test_tiny_cap_is_a_point_of_its_solid_angle():
    zonal = sh.cap(1e-6, 10)
    point = sh.basis(torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), 10)
    bands = torch.arange(10)
    assert torch.allclose(zonal / (math.pi * 1e-12), point[bands * (bands + 1)], rtol=FLOAT64["twin"])


@pytest.mark.parametrize("order", [1, 2, 5, 10])
def test_turned_lobe_depends_on_the_angle_to_its_axis_alone(order, directions, dtype, tolerance):
    zonal = sh.clamped_cosine(order, dtype)
    pole = torch.tensor([0.0, 0.0, 1.0], dtype=dtype)
    upright, axis = sh.rotate_zonal(zonal, pole), directions[50].to(dtype)
    assert (upright != 0).nonzero().reshape(-1).tolist() == [l * (l + 1) for l in range(order) if zonal[l] != 0]
    turned = sh.evaluate(sh.rotate_zonal(zonal, axis), directions.to(dtype))
    cosine = directions.to(dtype) @ axis
    meridian = torch.stack([(1 - cosine.square()).clamp_min(0).sqrt(), torch.zeros_like(cosine), cosine], dim=-1)
    assert torch.allclose(turned, sh.evaluate(upright, meridian), atol=10 * tolerance)


def test_directional_light_at_order_three():
    """Irradiance of a directional light of true maximum 1, l <= 2: the polynomial 3/32 + c/2 + 15/32 c²."""
    axis = torch.nn.functional.normalize(torch.tensor([0.2, -0.7, 0.4], dtype=torch.float64), dim=0)
    irradiance = sh.convolve(sh.basis(axis, 3), sh.clamped_cosine(3))
    assert torch.allclose(irradiance, sh.rotate_zonal(sh.clamped_cosine(3), axis), atol=1e-15)
    side = torch.nn.functional.normalize(torch.linalg.cross(axis, torch.eye(3).double()[0]), dim=0)
    cosine = torch.linspace(-1, 1, 2001, dtype=torch.float64)
    circle = cosine[:, None] * axis + (1 - cosine.square()).sqrt()[:, None] * side
    values = sh.evaluate(irradiance, circle)
    assert torch.allclose(values, 3 / 32 + cosine / 2 + 15 / 32 * cosine.square(), atol=1e-13)
    assert values[-1].item() == pytest.approx(1.0625, abs=FLOAT64["rounding"])
    assert values[0].item() == pytest.approx(0.0625, abs=FLOAT64["rounding"])
    value, direction, _ = sh.sphere_minimum(irradiance[:, None])
    assert value == pytest.approx(-19 / 480, abs=FLOAT64["rounding"])  # -0.039583
    assert (direction @ axis).item() == pytest.approx(-8 / 15, abs=FLOAT32["rounding"])
    error = (values - cosine.clamp_min(0)).abs()
    assert error.max().item() == pytest.approx(0.09375, abs=FLOAT64["rounding"])
    assert cosine[error.argmax()].abs().item() < FLOAT64["rounding"]


@pytest.mark.parametrize(("order", "minimum"), [(2, -0.25), (5, -0.03125), (7, -0.01552)])
def test_ringing_goes_on(order, minimum, directions):
    irradiance = sh.rotate_zonal(sh.clamped_cosine(order), directions[99])
    assert sh.sphere_minimum(irradiance[:, None])[0] == pytest.approx(minimum, abs=5e-6)


def test_convolution_by_quadrature(random):
    """Irradiance by its definition: the hemisphere integral of radiance times cosine."""
    radiance, frame = random(16, 3), torch.linalg.qr(random(3, 3))[0]
    nodes, weights = sh.sphere_quadrature(8)
    # The rule's z from -1..1 to 0..1, so that it covers the hemisphere about the frame's last axis alone;
    # every integrand has degree 3 + 1 in z once the azimuth is integrated.
    cosine = (nodes[:, 2] + 1) / 2
    ring = torch.nn.functional.normalize(nodes[:, :2], dim=-1) * (1 - cosine.square()).sqrt()[:, None]
    directions = torch.cat([ring, cosine[:, None]], dim=-1) @ frame.T
    expected = (sh.evaluate(radiance, directions) * (weights / 2 * cosine)[:, None]).sum(0)
    irradiance = sh.evaluate(sh.convolve(radiance, sh.clamped_cosine(4)), frame[:, 2])
    assert torch.allclose(irradiance, expected, atol=1e-13)


def test_convolution_commutes_with_rotation(random):
    rotation = torch.linalg.qr(random(3, 3))[0]
    coefficients, kernel = random(36, 3), random(6)
    first = sh.rotate(sh.convolve(coefficients, kernel), rotation)
    assert torch.allclose(first, sh.convolve(sh.rotate(coefficients, rotation), kernel), atol=1e-13)


def test_gradients(random):
    zonal, axis = random(5).requires_grad_(), random(4, 3).requires_grad_()
    assert torch.autograd.gradcheck(sh.rotate_zonal, (zonal, axis))
    assert torch.autograd.gradcheck(sh.convolve, (random(25, 2).requires_grad_(), zonal))
    assert torch.autograd.gradcheck(
        lambda angle: sh.cap(angle, 10), torch.tensor(0.4, dtype=torch.float64, requires_grad=True)
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sh.cap(0.0, 3), "half angle 0.0 is outside"),
        (lambda: sh.cap(4.0, 3), "half angle 4.0 is outside"),
        (lambda: sh.cap(math.nan, 3), "half angle nan is outside"),
        (lambda: sh.convolve(torch.ones(9, 3), torch.ones(4)), "order 3, zonal kernel has 4"),
        (lambda: sh.rotate_zonal(torch.ones(3, 1), torch.eye(3)), r"\[3, 1\]"),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()
