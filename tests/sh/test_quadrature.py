import pytest
import torch
from tolerances import FLOAT64

from diffprt import sh
from diffprt.errors import InputError


@pytest.mark.parametrize("degree", [0, 1, 2, 7, 18])
def test_quadrature_is_exact_to_its_degree_and_no_further(degree):
    directions, weights = sh.sphere_quadrature(degree)
    assert (weights > 0).all() and weights.sum().item() == pytest.approx(4 * torch.pi, rel=1e-14)
    assert torch.allclose(directions.norm(dim=-1), torch.ones_like(weights))
    # In z alone, then in x alone, which the steps in azimuth carry.
    for axis in (2, 0):
        for power in range(degree + 1):
            exact = 0 if power % 2 else 4 * torch.pi / (power + 1)
            assert (weights * directions[:, axis] ** power).sum().item() == pytest.approx(exact, abs=1e-13)
    above = 2 * (degree // 2 + 1)
    assert abs((weights * directions[:, 2] ** above).sum().item() - 4 * torch.pi / (above + 1)) > 1e-9


@pytest.mark.parametrize("order", [1, 3, 10])
def test_project_function_returns_the_coefficients(order, random):
    coefficients = random(order**2, 3)
    projected = sh.project_function(lambda d: sh.evaluate(coefficients, d), order, degree=2 * order - 2)
    assert torch.allclose(projected, coefficients, atol=1e-13)
    one = sh.project_function(lambda d: sh.evaluate(coefficients[:, 0], d), order)
    assert torch.allclose(one, coefficients[:, 0], atol=1e-13)


def test_project_function_of_a_smooth_lobe():
    """exp(k z) is the von Mises-Fisher lobe: its mean cosine is coth k - 1/k."""
    projected = sh.project_function(lambda d: torch.exp(3 * d[:, 2]), 4)
    ratio = projected[2] / projected[0] / 3**0.5
    assert ratio.item() == pytest.approx(1 / torch.tanh(torch.tensor(3.0)).item() - 1 / 3, abs=1e-7)
    assert projected[[1, 3, 4, 5, 7, 8]].abs().max() < FLOAT64["rounding"]


def test_project_function_gradients(random):
    coefficients = random(9, 2).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda c: sh.project_function(lambda d: sh.evaluate(c, d), 3, degree=6), coefficients
    )


def test_fit_recovers_a_band_limited_function(random, directions, dtype, tolerance):
    coefficients = random(36, 3)
    values = sh.evaluate(coefficients, directions)
    fitted = sh.fit_samples(directions.to(dtype), values.to(dtype), 6)
    assert fitted.dtype == dtype
    # Single-precision samples are wrong by 1e-7 of their size, up to 5 here, and the fit amplifies a little.
    assert (fitted.double() - coefficients).abs().max() < tolerance
    assert torch.allclose(sh.fit_samples(directions, values[:, 0], 6), coefficients[:, 0])


def test_ridge_shrinks_even_samples_as_documented(random):
    directions, _ = sh.sphere_quadrature(2)  # 6 directions, not enough for order 3
    coefficients = random(9, 2)
    with pytest.raises(InputError, match="6 samples leave 9 SH coefficients undetermined"):
        sh.fit_samples(directions, sh.evaluate(coefficients, directions), 3)
    shrunk = sh.fit_samples(directions, sh.evaluate(coefficients, directions), 3, ridge=1e-3)
    assert torch.isfinite(shrunk).all()

    even = torch.cat([torch.eye(3), -torch.eye(3)]).double()  # an octahedron: Gram matrix 1 for order 2
    linear = random(4, 2)
    damped = sh.fit_samples(even, sh.evaluate(linear, even), 2, ridge=1e-3)
    assert torch.allclose(damped * (1 + 1e-3), linear, atol=FLOAT64["rounding"])


def test_fit_gradients(directions, random):
    values = random(12, 2).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: sh.fit_samples(directions[20:32], v, 3, ridge=1e-3), values)


@pytest.mark.parametrize(
    ("directions", "values", "options", "message"),
    [
        (torch.eye(3).repeat(9, 1), torch.ones(27, 3), {}, "condition number .* give more directions"),
        (torch.eye(3), torch.ones(4, 3), {}, r"\[3, 3\], values \[4, 3\]"),
        (torch.eye(3), torch.full((3, 3), torch.nan), {}, "NaN"),
        (torch.eye(3), torch.ones(3, 3), {"ridge": -1.0}, "ridge -1.0 is negative"),
    ],
)
def test_fit_errors(directions, values, options, message):
    with pytest.raises(InputError, match=message):
        sh.fit_samples(directions, values, 3, **options)


def test_other_errors():
    with pytest.raises(InputError, match="degree -1 is negative"):
        sh.sphere_quadrature(-1)
    with pytest.raises(InputError, match="return"):
        sh.project_function(lambda d: d[:5, 0], 3)
