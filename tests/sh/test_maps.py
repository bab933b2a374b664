import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.errors import InputError

# Of the largest coefficient: sums of up to 131,072 texels in float64, then one rounding to the image's dtype.
ROUNDINGS = 64


def sky_and_sun(height: int, dtype: torch.dtype) -> tuple[torch.Tensor, torch.Tensor]:
    """A sky of radiance near 1, and a sun 1e5 times as bright that fills whole texels at 16 rows and up."""
    width = 2 * height
    coarse = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64) + 0.5
    scale = height // 16
    sky = coarse.repeat_interleave(scale, 0).repeat_interleave(scale, 1)
    sun = torch.zeros(height, width, 3, dtype=torch.float64)
    sun[5 * scale : 6 * scale, 9 * scale : 10 * scale] = 1e5
    return sky.to(dtype), sun.to(dtype)


def test_directions_follow_the_stated_convention(dtype, tolerance):
    grid = sh.map_directions(33, 65, dtype)
    assert grid.shape == (33, 65, 3) and grid.dtype == dtype
    assert torch.allclose(grid.norm(dim=-1), torch.ones(33, 65, dtype=dtype), atol=tolerance)
    assert grid[0, :, 1].min() > 0.99 and grid[-1, :, 1].max() < -0.99
    assert torch.allclose(grid[16, 32], torch.tensor([0.0, 0.0, -1.0], dtype=dtype), atol=tolerance)
    assert (grid[1:-1, 33:, 0] > 0).all() and (grid[1:-1, :32, 0] < 0).all()


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 3), (64, 128), (1000, 2000)])
def test_row_weights_sum_to_the_sphere(height, width):
    weights = sh.row_weights(height, width)
    assert weights.dtype == torch.float64 and (weights > 0).all()
    assert weights.sum().item() * width == pytest.approx(4 * math.pi, rel=1e-14)


def test_row_weights_are_exact_where_centre_sines_are_not():
    edges = torch.linspace(0, math.pi, 65, dtype=torch.float64).cos()
    assert torch.allclose(sh.row_weights(64), (edges[:-1] - edges[1:]) * 2 * math.pi / 128, rtol=FLOAT64["rounding"])
    sines = (math.pi * (torch.arange(64, dtype=torch.float64) + 0.5) / 64).sin()
    assert (sines.sum() * math.pi / 64 / 2).item() == pytest.approx(1.0001004, abs=5e-8)


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (3, 5), (64, 128)])
def test_constant_map_has_band_zero_alone(size, dtype, tolerance):
    projected = sh.project_map(torch.full((*size, 2), 3.0, dtype=dtype), 10)
    assert projected.dtype == dtype
    assert projected[0].tolist() == pytest.approx([3 * math.sqrt(4 * math.pi)] * 2, rel=tolerance)
    assert projected[1:].abs().max() < tolerance


def test_texels_are_integrated_exactly(random):
    """Against quadrature over each texel: Gauss in latitude and longitude, basis evaluated at directions."""
    height, width, order = 4, 7, 5
    image = random(height, width, 2)
    lattice, weights = sh.sphere_quadrature(30)
    lattice, weights = lattice[::31, 2], weights[::31] * 31 / (2 * math.pi)
    rows = math.pi / height * (torch.arange(height)[:, None] + (lattice + 1) / 2)
    columns = 2 * math.pi / width * (torch.arange(width)[:, None] + (lattice + 1) / 2) - math.pi
    t, p = rows[:, :, None, None], columns[None, None]
    directions = torch.stack(torch.broadcast_tensors(t.sin() * p.sin(), t.cos(), -t.sin() * p.cos()), dim=-1)
    area = weights[:, None, None] * weights * t.sin() * (math.pi / height / 2) * (2 * math.pi / width / 2)
    expected = torch.einsum(
        "hgwqk,hgwq,hwc->kc", sh.basis(directions, order), area.expand(directions.shape[:-1]), image
    )
    assert torch.allclose(sh.project_map(image, order), expected, atol=FLOAT64["rounding"])


def test_smooth_map_converges_as_documented(random):
    """Sampled at the centres, band l is off by about l (l + 1) (π / H)² / 24: a quarter per doubling."""
    coefficients = random(36, 3)
    errors = []
    for height in (64, 128, 256):
        error = sh.project_map(sh.render_map(coefficients, height, 2 * height), 6) - coefficients
        errors.append(error.abs().max().item())
        assert errors[-1] < 3 * 30 * (math.pi / height) ** 2 / 24
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("order", [1, 2, 5, 10])
def test_render_equals_evaluate(order, random, dtype, tolerance):
    coefficients = random(order**2, 2).to(dtype)
    rendered = sh.render_map(coefficients, 9, 14)
    assert rendered.dtype == dtype
    expected = sh.evaluate(coefficients, sh.map_directions(9, 14, dtype))
    assert (rendered - expected).abs().max() < 10 * tolerance


def test_bright_texel_lands_where_it_is(dtype):
    image = torch.zeros(32, 64, 3, dtype=dtype)
    image[4, 50] = 1.0
    direction = sh.map_directions(32, 64, torch.float64)[4, 50]
    lobe = sh.sphere_minimum(-sh.project_map(image, 6))[1]
    assert (lobe @ direction).item() > 0.9999
    ratio = sh.project_map(image, 6)[:, 0].double() / (sh.basis(direction, 6) * sh.row_weights(32)[4])
    assert ratio[0].item() == pytest.approx(1, rel=FLOAT32["rounding"])


def test_sun_and_sky_add_exactly(dtype):
    """Nothing of the sky is lost beside a sun 1e5 times as bright: no clamp, and float64 sums."""
    sky, sun = sky_and_sun(64, dtype)
    both, apart = sh.project_map((sky + sun), 6), sh.project_map(sky, 6) + sh.project_map(sun, 6)
    # 1e5 + 1 is exact in float64 but the image itself rounds the sum to 1e5 * 2^-24 in float32.
    assert (both - apart).abs().max() <= ROUNDINGS * torch.finfo(dtype).eps * apart.abs().max()
    if dtype == torch.float64:
        assert torch.allclose(both - sh.project_map(sun, 6), sh.project_map(sky, 6), atol=1e-9)


def test_half_precision_image_does_not_overflow():
    sky, sun = sky_and_sun(64, torch.float64)
    image = (sky + sun * 0.6).half()  # 6e4, just below the largest half; its sums are far above
    projected = sh.project_map(image, 6)
    assert projected.dtype == torch.float32 and torch.isfinite(projected).all()
    assert torch.allclose(projected, sh.project_map(image.double(), 6).float())
    assert sh.project_map(torch.full((64, 128, 1), 6e4).half(), 3)[0].item() == pytest.approx(212694.5, rel=1e-3)


def test_resolution_changes_nothing(dtype):
    reference = sh.project_map(sum(sky_and_sun(16, dtype)), 6)
    for height in (32, 64, 256):
        finer = sh.project_map(sum(sky_and_sun(height, dtype)), 6)
        assert (finer - reference).abs().max() < ROUNDINGS * torch.finfo(dtype).eps * reference.abs().max()


def test_row_blocks_change_nothing(monkeypatch, random):
    image = random(37, 20, 3)
    whole = sh.project_map(image, 4)
    monkeypatch.setattr("diffprt.sh.maps.BLOCK_TEXELS", 45)
    assert torch.allclose(sh.project_map(image, 4), whole, atol=1e-14)


def test_turning_the_map_about_y_turns_the_light(random):
    """Shifting the map right by a quarter moves what lies along -z to +x: a turn by -90 degrees about y."""
    image = random(8, 16, 3)
    turn = torch.tensor([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]], dtype=torch.float64)
    shifted = sh.project_map(image.roll(4, dims=1), 6)
    assert torch.allclose(shifted, sh.rotate(sh.project_map(image, 6), turn), atol=1e-13)


def test_gradients(random, monkeypatch):
    monkeypatch.setattr("diffprt.sh.maps.BLOCK_TEXELS", 12)  # several blocks
    image = random(5, 6, 2).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: sh.project_map(x, 4), image)
    assert torch.autograd.gradcheck(lambda c: sh.render_map(c, 3, 4), random(16, 2).requires_grad_())


def test_gradient_of_band_zero_is_the_solid_angle():
    image = torch.ones(64, 128, 1, requires_grad=True)
    sh.project_map(image, 6)[0].sum().backward()
    expected = (sh.row_weights(64) / math.sqrt(4 * math.pi)).float()[:, None, None].expand(64, 128, 1)
    assert torch.allclose(image.grad, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (torch.ones(4, 8), r"\[4, 8\]: give linear radiance"),
        (torch.ones(4, 8, 3, dtype=torch.uint8), "uint8"),
        (torch.ones(0, 8, 3), r"\[0, 8, 3\]"),
        (torch.tensor([1.0, torch.nan, torch.inf, 2.0]).reshape(2, 2, 1), "2 NaN or infinite texels of 4"),
    ],
)
def test_project_errors(image, message):
    with pytest.raises(InputError, match=message):
        sh.project_map(image, 3)


def test_size_errors():
    for call in (
        lambda: sh.map_directions(0, 4),
        lambda: sh.row_weights(4, 0),
        lambda: sh.render_map(torch.ones(4, 3), 0, 8),
    ):
        with pytest.raises(InputError, match="has no texels"):
            call()
    with pytest.raises(InputError, match=r"\[4\]"):
        sh.render_map(torch.ones(4), 4, 8)
