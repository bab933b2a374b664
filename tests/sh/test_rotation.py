import math

import pytest
import torch
from tolerances import FLOAT64

from diffprt import sh
from diffprt.errors import InputError


def about(axis: int, angle: float) -> torch.Tensor:
    """Rotation about a coordinate axis, counterclockwise seen from its tip."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = torch.eye(3, dtype=torch.float64)
    matrix[i, i] = matrix[j, j] = math.cos(angle)
    matrix[j, i], matrix[i, j] = math.sin(angle), -math.sin(angle)
    return matrix


def euler(alpha: float, beta: float, gamma: float) -> torch.Tensor:
    return about(2, alpha) @ about(1, beta) @ about(2, gamma)


# beta is where constructions by Euler angles degenerate: 0, pi, and next to them.
BETAS = {
    "zero": 0.0,
    "near zero": 1e-7,
    "right angle": math.pi / 2,
    "general": 1.234,
    "near pi": math.pi - 1e-7,
    "nearer pi": math.pi - 1e-12,
    "pi": math.pi,
}


@pytest.fixture(params=BETAS.values(), ids=BETAS.keys())
def rotation(request) -> torch.Tensor:
    return euler(0.7, request.param, -2.1)


@pytest.mark.parametrize("order", [1, 2, 3, 6, 10])
def test_turned_function_at_d_is_the_function_at_the_direction_turned_back(
    order, rotation, random, directions, dtype, tolerance
):
    coefficients = random(order**2, 3).to(dtype)
    turned = sh.rotate(coefficients, rotation.to(dtype))
    assert turned.dtype == dtype
    expected = sh.evaluate(coefficients.double(), directions @ rotation)  # rows of d R are Rᵀ d
    # Sums of up to 100 terms of order 1 to 3.
    assert (sh.evaluate(turned.double(), directions) - expected).abs().max() < 10 * tolerance


def test_blocks_are_orthogonal(rotation, dtype, tolerance):
    blocks = sh.rotation_matrices(rotation.to(dtype), 10)
    assert [block.shape for block in blocks] == [(2 * l + 1, 2 * l + 1) for l in range(10)]
    for block in blocks:
        assert (block.T @ block - torch.eye(len(block), dtype=dtype)).abs().max() < tolerance


def test_power_per_band_is_kept(rotation, random, dtype, tolerance):
    coefficients = random(100).to(dtype)
    widths = [2 * l + 1 for l in range(10)]
    before, after = coefficients.split(widths), sh.rotate(coefficients, rotation.to(dtype)).split(widths)
    for band, turned in zip(before, after, strict=True):
        assert turned.square().sum().item() == pytest.approx(band.square().sum().item(), rel=tolerance)


def test_composition_and_inverse(rotation, dtype, tolerance):
    first, second = rotation.to(dtype), euler(-0.4, 2.2, 0.9).to(dtype)
    product = sh.rotation_matrix(second, 10) @ sh.rotation_matrix(first, 10)
    assert (product - sh.rotation_matrix(second @ first, 10)).abs().max() < tolerance
    assert (sh.rotation_matrix(first.T, 10) - sh.rotation_matrix(first, 10).T).abs().max() < tolerance


def test_identity_is_exact(dtype, tolerance):
    matrix = sh.rotation_matrix(torch.eye(3, dtype=dtype), 10)
    assert (matrix - torch.eye(100, dtype=dtype)).abs().max() < tolerance


def test_a_quarter_turn_about_y_takes_a_lobe_from_z_to_x():
    zonal = sh.clamped_cosine(10)
    x, _, z = torch.eye(3, dtype=torch.float64)
    turned = sh.rotate(sh.rotate_zonal(zonal, z), about(1, math.pi / 2))
    assert torch.allclose(turned, sh.rotate_zonal(zonal, x), atol=1e-14)


def test_turn_about_the_polar_axis_mixes_plus_and_minus_m_only():
    angle = 0.3
    matrix = sh.rotation_matrix(about(2, angle), 10)
    for l in range(10):
        for m in range(1, l + 1):
            plus, minus = l * (l + 1) + m, l * (l + 1) - m
            assert matrix[plus, plus].item() == pytest.approx(math.cos(m * angle), abs=1e-13)
            assert matrix[minus, plus].item() == pytest.approx(math.sin(m * angle), abs=1e-13)
    assert torch.count_nonzero(matrix.abs() > 1e-13) == 10 + 4 * 45


def test_reflection_obeys_the_same_law(random, directions):
    mirror = torch.diag(torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)) @ euler(0.7, 1.1, 0.2)
    coefficients = random(100)
    turned = sh.evaluate(sh.rotate(coefficients, mirror), directions)
    assert torch.allclose(turned, sh.evaluate(coefficients, directions @ mirror), atol=FLOAT64["rounding"])


@pytest.mark.parametrize("beta", [0.0, 1.0, math.pi])
def test_gradients_reach_coefficients_and_rotation(beta, random):
    rotation = euler(0.3, beta, 0.5).requires_grad_()
    assert torch.autograd.gradcheck(sh.rotate, (random(25, 2).requires_grad_(), rotation))


def test_gradient_with_respect_to_an_angle_at_order_ten(random, directions):
    """d/da f(Rᵀ(a) d) at a = 0, for turns about x, is the derivative of f along -(x cross d)."""
    coefficients = random(100)
    generator = torch.tensor([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=torch.float64)
    angle = torch.zeros((), dtype=torch.float64)

    def turned(a: torch.Tensor) -> torch.Tensor:
        return sh.evaluate(sh.rotate(coefficients, torch.eye(3) + a * generator), directions)

    rate = torch.autograd.functional.jacobian(turned, angle)
    axis = torch.tensor([1.0, 0, 0], dtype=torch.float64).expand_as(directions)
    along = -torch.linalg.cross(axis, directions)
    expected = torch.autograd.functional.jvp(lambda d: sh.evaluate(coefficients, d), directions, along)[1]
    assert torch.allclose(rate, expected, atol=FLOAT64["twin"])


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (torch.eye(3) * 1.001, "not orthonormal .* by 0.002"),
        (torch.tensor([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "not orthonormal"),
        (torch.full((3, 3), torch.nan), "not orthonormal"),
        (torch.eye(4), r"\[4, 4\]"),
        (torch.eye(3, dtype=torch.int64), "floating"),
    ],
)
def test_errors(matrix, message):
    with pytest.raises(InputError, match=message):
        sh.rotate(torch.ones(9, 3), matrix)
    with pytest.raises(InputError, match="7 SH coefficients"):
        sh.rotate(torch.ones(7, 3), torch.eye(3))
