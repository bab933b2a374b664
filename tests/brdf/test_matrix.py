"""BRDF matrices: analytic answers, Monte Carlo, and the least-squares fit."""

import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.brdf import (
    GGX,
    CookTorrance,
    Lambert,
    ModifiedPhong,
    Phong,
    brdf_matrix,
    exit_fit,
    fitted_matrix,
    hemisphere_gram,
    hemisphere_moments,
    westin_matrix,
)
from diffprt.errors import InputError


def test_hemisphere_integrals():
    cosine = hemisphere_moments(6, cosine=True)
    bands = torch.arange(6)
    assert torch.allclose(cosine[bands * (bands + 1)], sh.clamped_cosine(6), atol=FLOAT64["rounding"])
    even = hemisphere_moments(6, cosine=False)
    assert torch.allclose(even[bands * (bands + 1)], sh.cap(math.pi / 2, 6), atol=FLOAT64["rounding"])
    gram = hemisphere_gram(4, cosine=False)
    # The two hemispheres together make the identity; the lower one is the mirror image, with parity (-1)^(l+m).
    parity = torch.tensor([(-1.0) ** (l + m) for l in range(4) for m in range(-l, l + 1)], dtype=torch.float64)
    assert torch.allclose(
        gram + parity[:, None] * gram * parity, torch.eye(16, dtype=torch.float64), atol=FLOAT64["rounding"]
    )
    assert torch.allclose(
        hemisphere_gram(4, cosine=True)[0] * math.sqrt(4 * math.pi), cosine[:16], atol=FLOAT64["rounding"]
    )


def test_lambert_is_an_outer_product():
    matrix = brdf_matrix(Lambert(0.6), 5, 4)
    expected = 0.6 / math.pi * hemisphere_moments(5, cosine=False)[:, None] * hemisphere_moments(4, cosine=True)
    assert torch.allclose(matrix[0], expected, atol=1e-14)


@pytest.mark.parametrize(
    "brdf",
    [Lambert(0.5), Phong(12.0), ModifiedPhong(40.0, diffuse=0.3, specular=0.5), CookTorrance(0.4), GGX(0.2)],
    ids=lambda b: type(b).__name__,
)
def test_quadrature_agrees_with_monte_carlo(brdf, generator):
    matrix = brdf_matrix(brdf, 4, 5)
    estimate, error = westin_matrix(brdf, 4, 5, samples=1 << 16, generator=generator)
    deviation = (matrix - estimate) / (error + 1e-6)
    assert float(error.max()) < 0.05
    # Many correlated entries: the worst of 400 stays within 5 standard errors, their mean square near 1.
    assert float(deviation.abs().max()) < 5
    assert 0.3 < float(deviation.square().mean()) < 2


@pytest.mark.parametrize("brdf", [ModifiedPhong(1e6), GGX(1e-3), CookTorrance(1e-3)], ids=lambda b: type(b).__name__)
def test_sharp_lobes_tend_to_a_mirror(brdf):
    """∫ rho cos f dw_i -> f(mirror direction), times cos θ for Phong: the moments have a closed limit."""
    matrix = brdf_matrix(brdf, 4, 4)[0]
    flip = torch.tensor([(-1.0) ** abs(m) for l in range(4) for m in range(-l, l + 1)], dtype=torch.float64)
    mirror = hemisphere_gram(4, cosine=isinstance(brdf, ModifiedPhong)) * flip
    assert float((matrix - mirror).abs().max()) < 4e-3


@pytest.mark.parametrize(
    ("brdf", "error"),
    [
        (ModifiedPhong(0.0), 3e-4),  # a lobe that ends in a step
        (ModifiedPhong(1.0), 4e-6),
        (ModifiedPhong(1e6), 4e-6),
        (CookTorrance(1e-3), 4e-6),
        (CookTorrance(0.3), 4e-6),
        (GGX(0.05), 4e-6),
    ],
)
def test_quadrature_has_converged(brdf, error):
    usual, finer = (brdf_matrix(brdf, 5, 5, exit_cosine=True, **more) for more in ({}, {"nodes": 100}))
    assert float((usual - finer).abs().max()) < error * float(finer.abs().max())


def test_reciprocal_brdfs_have_symmetric_matrices(reciprocal):
    moments = brdf_matrix(reciprocal, 4, 4, exit_cosine=True)
    # Quadrature treats the two sides differently: what is left is its error, the largest at exponent 0.
    assert float((moments - moments.transpose(1, 2)).abs().max()) < 3e-4 * float(moments.abs().max())


def test_furnace():
    """Under constant light, exit radiance is the directional albedo; averaged with the cosine it is the flux."""
    brdf = ModifiedPhong(20.0, diffuse=0.2, specular=0.7)
    light = torch.zeros(25, dtype=torch.float64)
    light[0] = math.sqrt(4 * math.pi)
    exit_light = fitted_matrix(brdf, 5, 5)[0] @ hemisphere_gram(5, cosine=True) @ light
    flux = hemisphere_moments(5, cosine=True) @ exit_light / math.pi
    straight = brdf_matrix(brdf, 1, 5, exit_cosine=True)[0, 0] @ light * math.sqrt(4 * math.pi) / math.pi
    assert float(flux) == pytest.approx(float(straight), rel=1e-9)
    assert 0.5 < float(flux) < 0.9


@pytest.mark.parametrize("order", [1, 3, 6])
def test_lambert_fits_exactly_at_every_order(order):
    fit = fitted_matrix(Lambert(0.6), order, order)[0]
    expected = torch.zeros_like(fit)
    expected[0, 0] = 0.6 / math.pi * 4 * math.pi
    # The Gram matrix of order 6 has a condition number of 1e8.
    assert float((fit - expected).abs().max()) < FLOAT32["rounding"]


def test_fit_of_what_the_basis_holds_is_exact():
    """Without ridge, a function of the order is recovered from its moments above the surface alone."""
    c = torch.randn(16, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    assert torch.allclose(exit_fit(4, ridge=0.0) @ hemisphere_gram(4, cosine=True) @ c, c, atol=1e-9)
    with pytest.raises(InputError, match="ridge is -1"):
        exit_fit(4, ridge=-1)


def test_fit_beats_the_projection_with_zero_below():
    """Exit radiance of a Phong lobe at order 6, against quadrature of a higher order: 3 times closer."""
    brdf, order = ModifiedPhong(16.0), 6
    light = torch.randn(36, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) / (1 + sh.band_of_index(6))
    views = torch.tensor([[math.sqrt(1 - z * z), 0, z] for z in (0.95, 0.7, 0.4)], dtype=torch.float64)
    incoming, weights = sh.sphere_quadrature(200)
    rho = brdf.evaluate(incoming, views[:, None].expand(-1, len(incoming), 3))[..., 0]
    truth = rho * incoming[:, 2].clamp_min(0) * weights @ sh.evaluate(light, incoming)
    fitted = sh.basis(views, order) @ fitted_matrix(brdf, order, order)[0] @ hemisphere_gram(order, cosine=True) @ light
    zeroed = sh.basis(views, order) @ brdf_matrix(brdf, order, order)[0] @ light
    assert float((fitted - truth).norm()) < 0.02 * float(truth.norm())
    assert float((fitted - truth).norm()) < 0.33 * float((zeroed - truth).norm())


@pytest.mark.parametrize("kind", [ModifiedPhong, GGX])
def test_gradients_of_the_matrix(kind):
    """Against central differences, to their own error of a hundredth squared."""
    start = 8.0 if kind is ModifiedPhong else 0.4
    shape = torch.tensor(start, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(9, 9, dtype=torch.float64, generator=torch.Generator().manual_seed(3))

    def loss(value):
        return (fitted_matrix(kind(value, diffuse=0.1, specular=0.8), 3, 3)[0] * weight).sum()

    loss(shape).backward()
    step = 1e-2 * start
    with torch.no_grad():
        difference = (loss(shape + step) - loss(shape - step)) / (2 * step)
    assert float(shape.grad) == pytest.approx(float(difference), rel=1e-3)


def test_colored_weights_color_the_matrix():
    colored = brdf_matrix(ModifiedPhong(8.0, diffuse=0.1, specular=(0.2, 0.4, 0.8)), 3, 3)
    plain = [brdf_matrix(ModifiedPhong(8.0, diffuse=0.1, specular=w), 3, 3)[0] for w in (0.2, 0.4, 0.8)]
    assert torch.allclose(colored, torch.stack(plain), atol=FLOAT64["rounding"])
