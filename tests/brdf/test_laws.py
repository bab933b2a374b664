"""Reciprocity, energy, sampling, and what parameters at the edge of their range give."""

import math

import pytest
import torch
from tolerances import FLOAT64

from diffprt import sh
from diffprt.brdf import GGX, Conductor, CookTorrance, Lambert, ModifiedPhong, Phong, Schlick
from diffprt.errors import InputError
from diffprt.sh.frames import tangent_frames


def directions(*cosines: float) -> torch.Tensor:
    z = torch.tensor(cosines, dtype=torch.float64)
    return torch.stack([(1 - z * z).sqrt(), torch.zeros_like(z), z], dim=-1)


def albedo(brdf, outgoing: torch.Tensor) -> torch.Tensor:
    """Directional-hemispherical reflectance [..., C] by a product rule over the whole sphere."""
    incoming, weights = sh.sphere_quadrature(150)
    rho = brdf.evaluate(incoming, outgoing[:, None].expand(-1, len(incoming), 3))
    return torch.einsum("oqc,q->oc", rho, weights * incoming[:, 2].clamp_min(0))


def test_lambert_is_albedo_over_pi(upper):
    value = Lambert((0.2, 0.5, 0.8)).evaluate(upper, upper.flip(0))
    assert torch.allclose(value, torch.tensor([0.2, 0.5, 0.8], dtype=torch.float64) / math.pi)


def test_reciprocity(reciprocal, upper):
    forth, back = reciprocal.evaluate(upper, upper.flip(0)), reciprocal.evaluate(upper.flip(0), upper)
    assert torch.allclose(forth, back, rtol=1e-9, atol=FLOAT64["rounding"])


def test_original_phong_is_not_reciprocal(upper):
    forth, back = Phong(16.0).evaluate(upper, upper.flip(0)), Phong(16.0).evaluate(upper.flip(0), upper)
    ratio = upper[:, 2:] / upper.flip(0)[:, 2:]
    assert torch.allclose(forth * ratio, back)
    assert float((ratio - 1).abs().max()) > 0.5


def test_albedo_is_at_most_one(reciprocal):
    """Hard case 10. Half a percent is left to the quadrature of lobes that the horizon cuts."""
    assert float(albedo(reciprocal, directions(0.99, 0.7, 0.4, 0.1)).max()) <= 1.005


def test_modified_phong_reflects_all_it_can_at_the_normal():
    """At normal incidence the lobe is whole: ∫ (n+2)/2π cosⁿ⁺¹ = 1."""
    assert float(albedo(ModifiedPhong(16.0), directions(1.0))) == pytest.approx(1, abs=1e-3)


def test_original_phong_creates_energy_at_grazing_light():
    """Light from w reflects ∫ lobe cos θ_o / cos θ_i: (n+1)/2π cosⁿα over its whole lobe, without the cosine."""
    incoming = directions(0.05)
    outgoing, weights = sh.sphere_quadrature(150)
    rho = Phong(16.0).evaluate(incoming.expand_as(outgoing), outgoing)[:, 0]
    assert float((rho * outgoing[:, 2].clamp_min(0) * weights).sum()) > 1.5


def test_nothing_is_reflected_below_the_surface(brdf, upper):
    down = upper * upper.new_tensor([1.0, 1.0, -1.0])
    assert float(brdf.evaluate(upper, down).abs().max()) == 0
    assert float(brdf.evaluate(down, upper).abs().max()) == 0


def test_densities_integrate_to_one(brdf):
    nodes, weights = sh.sphere_quadrature(200)
    for outgoing in directions(0.9, 0.3):
        # Facets seen edge-on send samples straight back, with a density like 1/angle: the rule has its pole there, and
        # misses 0.8 % of it.
        incoming = nodes @ tangent_frames(outgoing).T
        density = brdf.pdf(incoming, outgoing.expand_as(incoming))
        assert float(density @ weights) == pytest.approx(1, abs=0.01)


def test_samples_follow_their_density(brdf, generator):
    """Chi-square over cells of equal area in (z, azimuth), 5 standard deviations."""
    outgoing, count, columns, rows = directions(0.6)[0], 40000, 12, 10
    samples = brdf.sample(outgoing.expand(count, 3), torch.rand(count, 2, dtype=torch.float64, generator=generator))
    assert torch.allclose(samples.norm(dim=-1), torch.ones(count, dtype=torch.float64))

    def cells(d: torch.Tensor) -> torch.Tensor:
        column = ((torch.atan2(d[:, 1], d[:, 0]) / (2 * math.pi) + 0.5) * columns).long().clamp(0, columns - 1)
        return ((d[:, 2] + 1) / 2 * rows).long().clamp(0, rows - 1) * columns + column

    found = torch.bincount(cells(samples), minlength=rows * columns).double()
    fine = 40
    z = 2 * (torch.arange(rows * fine, dtype=torch.float64) + 0.5) / (rows * fine) - 1
    angle = 2 * math.pi * ((torch.arange(columns * fine, dtype=torch.float64) + 0.5) / (columns * fine)) - math.pi
    radius = (1 - z * z).sqrt()[:, None]
    nodes = torch.stack([radius * angle.cos(), radius * angle.sin(), z[:, None].expand(-1, len(angle))], dim=-1)
    density = brdf.pdf(nodes, outgoing.expand_as(nodes)).reshape(rows, fine, columns, fine).mean((1, 3)).flatten()
    expected = density * (4 * math.pi / (rows * columns)) * count
    kept = expected > 5
    # The midpoint rule inside a cell leaves 0.2 % of it, which the denominator allows for.
    statistic = ((found - expected)[kept] ** 2 / (expected + (0.002 * expected) ** 2)[kept]).sum()
    freedom = int(kept.sum())
    assert freedom > 10
    assert float(statistic) < freedom + 5 * math.sqrt(2 * freedom)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_sharpest_lobes_are_finite_and_whole(dtype):
    """Exponent 1e6 and roughness 0.001, in float32 too: the peak is where it belongs, to 1 %."""
    outgoing = directions(0.6).to(dtype)
    mirror = outgoing * outgoing.new_tensor([-1.0, -1.0, 1.0])
    for brdf, peak in (
        (ModifiedPhong(1e6), (1e6 + 2) / (2 * math.pi)),
        (GGX(1e-3), 1 / (math.pi * 1e-6 * 4 * 0.36)),
        (CookTorrance(1e-3), 1 / (math.pi * 1e-6 * 4 * 0.36)),
    ):
        assert float(brdf.evaluate(mirror, outgoing)) == pytest.approx(peak, rel=1e-2)
        assert torch.isfinite(brdf.evaluate(outgoing, outgoing)).all()


def test_exponent_zero_is_even_over_the_mirrored_hemisphere():
    value = ModifiedPhong(0.0).evaluate(directions(0.3, 0.9), directions(1.0, 1.0))
    assert torch.allclose(value, torch.full_like(value, 1 / math.pi))


def test_white_facets_reflect_everything_and_a_metal_less():
    cosine = torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64)
    assert torch.equal(Schlick(1.0)(cosine), torch.ones(3, 1, dtype=torch.float64))
    # Normal incidence: ((eta - 1)² + k²) / ((eta + 1)² + k²); grazing: 1.
    metal = Conductor(0.2, 3.9)(cosine)[:, 0]
    assert metal.tolist()[::2] == pytest.approx([1, (0.64 + 15.21) / (1.44 + 15.21)])
    assert 0 < float(metal[1]) < 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ModifiedPhong(2e6), "exponent is 2000000"),
        (lambda: ModifiedPhong(float("nan")), "exponent is nan"),
        (lambda: Phong(-1.0), "exponent is -1"),
        (lambda: GGX(0.0), "roughness 0 is a mirror"),
        (lambda: CookTorrance(1.5), "roughness is 1.5"),
        (lambda: GGX(0.2, masking="none"), "masking 'none' is unknown"),
        (lambda: GGX(torch.tensor([0.1, 0.2])), "roughness has shape"),
        (lambda: Lambert(1.2), "diffuse weight is 1.2"),
        (lambda: ModifiedPhong(8.0, diffuse=0.6), "add up to 1.6"),
        (lambda: Schlick((0.1, 2.0, 0.1)), "f0 is"),
        (lambda: Conductor(0.0, 1.0), "eta is 0"),
    ],
)
def test_bad_parameters_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("kind", [ModifiedPhong, Phong, CookTorrance, GGX])
def test_gradients_reach_parameters_and_directions(kind, upper):
    start = 3.0 if kind in (ModifiedPhong, Phong) else 0.4
    inputs = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (start, 0.2, 0.7)]
    some = (upper[:6] * upper.new_tensor([1.0, 1.0, 2.0])).requires_grad_()

    def value(shape, diffuse, specular, incoming):
        return kind(shape, diffuse=diffuse, specular=specular).evaluate(incoming, upper[6:12])

    assert torch.autograd.gradcheck(value, (*inputs, some))


def test_gradients_are_finite_below_the_horizon():
    for kind, start in ((ModifiedPhong, 5.0), (GGX, 0.3), (CookTorrance, 0.3)):
        shape = torch.tensor(start, requires_grad=True)
        incoming = torch.tensor([[0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], requires_grad=True)
        outgoing = torch.tensor([[0.0, 0.0, 1.0]]).expand(3, 3)
        kind(shape).evaluate(incoming, outgoing).sum().backward()
        assert torch.isfinite(shape.grad) and torch.isfinite(incoming.grad).all()
