import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

from diffprt import sh
from diffprt.errors import InputError

ORDERS = range(1, 11)


def scipy_basis(directions: torch.Tensor, order: int) -> torch.Tensor:
    """The real basis from scipy's complex harmonics, by angles: nothing shared with the code under test."""
    x, y, z = directions.double().numpy().T
    polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    columns = []
    for l in range(order):
        for m in range(-l, l + 1):
            value = sph_harm_y(l, abs(m), polar, azimuth)
            columns.append(value.real if m == 0 else np.sqrt(2) * (value.real if m > 0 else value.imag))
    return torch.from_numpy(np.stack(columns, axis=-1))


@pytest.mark.parametrize("order", ORDERS)
def test_agrees_with_scipy(order, directions, dtype, tolerance):
    values = sh.basis(directions.to(dtype), order)
    assert values.dtype == dtype and values.shape == (206, order**2)
    assert (values.double() - scipy_basis(directions, order)).abs().max() < tolerance


def test_band_one_is_minus_y_z_minus_x(directions, dtype, tolerance):
    x, y, z = directions.to(dtype).unbind(-1)
    expected = (3 / (4 * torch.pi)) ** 0.5 * torch.stack([-y, z, -x], dim=-1)
    assert torch.allclose(sh.basis(directions.to(dtype), 2)[:, 1:], expected, atol=tolerance)


def test_orthonormal(dtype, tolerance):
    points, weights = sh.sphere_quadrature(18)
    values = sh.basis(points.to(dtype), 10)
    gram = values.T @ (values * weights.to(dtype)[:, None])
    assert (gram - torch.eye(100, dtype=dtype)).abs().max() < tolerance


def test_addition_theorem(directions, dtype, tolerance):
    """Over a band, the sum of y(a) y(b) is (2l+1)/4pi times the Legendre polynomial of their cosine."""
    a, b = directions[:103].to(dtype), directions[103:].to(dtype)
    products = sh.basis(a, 10) * sh.basis(b, 10)
    cosine = (directions[:103] * directions[103:]).sum(-1).numpy()
    for l, band in enumerate(products.split([2 * l + 1 for l in range(10)], dim=-1)):
        legendre = torch.from_numpy(np.polynomial.legendre.Legendre.basis(l)(cosine))
        assert (band.sum(-1).double() - (2 * l + 1) / (4 * torch.pi) * legendre).abs().max() < tolerance


def test_parity(directions, dtype, tolerance):
    signs = (-1.0) ** sh.band_of_index(10)
    flipped = sh.basis(-directions.to(dtype), 10)
    assert torch.allclose(flipped, sh.basis(directions.to(dtype), 10) * signs.to(dtype), atol=tolerance)


def test_lower_order_is_a_prefix(directions):
    assert torch.equal(sh.basis(directions, 4), sh.basis(directions, 10)[:, :16])


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_poles_have_finite_values_and_gradients(pole, dtype, tolerance):
    direction = torch.tensor([0.0, 0.0, pole], dtype=dtype, requires_grad=True)
    values, jacobian = (
        sh.basis(direction, 10),
        torch.autograd.functional.jacobian(lambda d: sh.basis(d, 10), direction),
    )
    bands = torch.arange(10, dtype=dtype)
    expected = torch.zeros(100, dtype=dtype)
    expected[(bands * (bands + 1)).long()] = ((2 * bands + 1) / (4 * torch.pi)).sqrt() * pole**bands
    assert torch.allclose(values, expected, atol=tolerance)
    assert torch.isfinite(jacobian).all()
    # At the pole y_{l,±1} alone slopes sideways: y_{1,1} by -sqrt(3/4pi) along x.
    assert jacobian[3, 0].item() == pytest.approx(-((3 / (4 * np.pi)) ** 0.5), abs=tolerance)


def test_slightly_long_direction_changes_a_batch_slightly(directions, dtype):
    batch = directions.to(dtype)
    longer = batch.clone()
    longer[:6] *= 1 + 1e-7
    difference = (sh.basis(longer, 10) - sh.basis(batch, 10)).abs()
    assert torch.isfinite(difference).all()
    assert difference[:6].max() < 1e-4 and difference[6:].max() == 0
    assert sh.basis(longer, 10)[:6].abs().amax(-1).min() > 0.28


def test_gradients(directions):
    points = directions[[2, 5, 30]].clone().requires_grad_()  # both poles and a general direction
    assert torch.autograd.gradcheck(lambda d: sh.basis(d, 10), points)
    assert torch.autograd.gradgradcheck(lambda d: sh.basis(d, 3), points)


def test_evaluate_gradients_reach_both(directions, random):
    coefficients = random(16, 2).requires_grad_()
    assert torch.autograd.gradcheck(sh.evaluate, (coefficients, directions[:5].clone().requires_grad_()))


def test_evaluate_shapes(directions, random):
    coefficients = random(9, 3)
    grid = directions[:200].reshape(10, 20, 3)
    assert sh.evaluate(coefficients, grid).shape == (10, 20, 3)
    assert sh.evaluate(coefficients[:, 0], grid).shape == (10, 20)
    assert torch.allclose(sh.evaluate(coefficients, grid)[4, 5], coefficients.T @ sh.basis(grid[4, 5], 3))


def test_recurrence_tables_rebuild_the_basis(directions, dtype, tolerance):
    """The recurrence as documented, one scalar at a time, the way a kernel runs it."""
    order = 7
    diagonal, a, b = sh.recurrence_tables(order, dtype)
    assert diagonal.shape == (order,) and a.shape == b.shape == (order**2,) and a.dtype == dtype
    for direction in directions[[0, 2, 5, 20, 77]].to(dtype):
        x, y, z = direction
        values = torch.zeros(order**2, dtype=dtype)
        cosine, sine = torch.tensor(1.0, dtype=dtype), torch.tensor(0.0, dtype=dtype)
        for m in range(order):
            below, current = torch.tensor(0.0, dtype=dtype), diagonal[m]
            for l in range(m, order):
                if l > m:
                    i = l * (l + 1) + m
                    below, current = current, a[i] * z * current - b[i] * below
                values[l * (l + 1) - m] = current * sine
                values[l * (l + 1) + m] = current * cosine
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        assert torch.allclose(values, sh.basis(direction, order), atol=tolerance)


def test_indices():
    assert [sh.coefficient_count(order) for order in ORDERS] == [1, 4, 9, 16, 25, 36, 49, 64, 81, 100]
    assert sh.band_of_index(3).tolist() == [0, 1, 1, 1, 2, 2, 2, 2, 2]
    assert [sh.order_of_count(order**2) for order in ORDERS] == list(ORDERS)


@pytest.mark.parametrize("order", [40, 0, -1, 11])
@pytest.mark.parametrize(
    "function",
    [
        sh.check_order,
        sh.coefficient_count,
        sh.band_of_index,
        lambda n: sh.rotation_matrices(torch.eye(3), n),
        lambda n: sh.window("hann", n),
        sh.clamped_cosine,
        lambda n: sh.cap(0.5, n),
        lambda n: sh.project_map(torch.ones(4, 8, 3), n),
        lambda n: sh.project_polygon(torch.eye(3), n),
        lambda n: sh.project_function(lambda d: d[:, 0], n),
        lambda n: sh.fit_samples(torch.eye(3), torch.eye(3), n),
    ],
)
def test_order_outside_the_range(function, order):
    with pytest.raises(InputError, match=rf"^order {order} is outside 1\.\.10: give order=1 to order=10[^\n]*$"):
        function(order)


def test_orthonormal_up_to_the_order_of_products():
    directions, weights = sh.sphere_quadrature(36)
    values = sh.basis(directions, 19)
    gram = values.T @ (weights[:, None] * values)
    assert float((gram - torch.eye(361, dtype=torch.float64)).abs().max()) < 1e-11


@pytest.mark.parametrize("order", [0, -1, 20, 40])
@pytest.mark.parametrize("function", [lambda n: sh.basis(torch.eye(3), n), sh.recurrence_tables])
def test_order_beyond_products(function, order):
    with pytest.raises(InputError, match=rf"^order {order} is outside 1\.\.19: give order=1 to order=19[^\n]*$"):
        function(order)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sh.check_order(2.5), "order 2.5 is not a whole number"),
        (lambda: sh.basis(torch.ones(4, 2), 3), r"\[4, 2\]"),
        (lambda: sh.basis(torch.ones(4, 3, dtype=torch.int64), 3), "floating"),
        (lambda: sh.evaluate(torch.ones(5, 3), torch.eye(3)), "5 SH coefficients"),
        (lambda: sh.order_of_count(121), "121 SH coefficients"),
    ],
)
def test_errors_name_what_was_found(call, message):
    with pytest.raises(InputError, match=message):
        call()
