import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.errors import InputError


def ringing_light(random, order: int) -> torch.Tensor:
    """Three channels of two directional lights of different colour: rings in every channel."""
    axes = torch.nn.functional.normalize(random(2, 3), dim=-1)
    return sh.basis(axes, order).T @ torch.tensor([[1.0, 0.7, 0.2], [0.1, 0.5, 0.9]], dtype=torch.float64)


def test_fixed_windows_by_hand(dtype, tolerance):
    half = math.sqrt(0.5)
    table = {
        "none": [1, 1, 1, 1],
        "hann": [1, (1 + half) / 2, 0.5, (1 - half) / 2],
        "lanczos": [1, 4 * half / math.pi, 2 / math.pi, 4 * half / (3 * math.pi)],
    }
    for name, expected in table.items():
        factors = sh.window(name, 4, dtype)
        assert factors.dtype == dtype
        assert factors.tolist() == pytest.approx(expected, abs=tolerance)


def test_band_one_factor_of_a_half_just_removes_the_minimum_of_a_quarter(directions):
    """l <= 1 of a clamped cosine is 1/4 + c/2. Hann at order 2 is that half; auto finds it."""
    irradiance = sh.rotate_zonal(sh.clamped_cosine(2), directions[40])
    for name in ("hann", "auto"):
        _, report = sh.apply_window(irradiance, name)
        assert report["factors"] == pytest.approx([1, 0.5], abs=FLOAT64["rounding"])
        assert report["minimum_before"] == pytest.approx(-0.25, abs=FLOAT64["rounding"])
        assert report["minimum_after"] == pytest.approx(0, abs=FLOAT64["rounding"])
        assert report["peak_before"] == pytest.approx(0.75, abs=FLOAT64["rounding"])
        assert report["peak_after"] == pytest.approx(0.5, abs=FLOAT64["rounding"])
        assert report["contrast"] == pytest.approx(2 / 3, abs=FLOAT64["rounding"])
        assert report["contrast_cost"] == pytest.approx(1 / 3, abs=FLOAT64["rounding"])
        # Energies of the bands are pi/4 and pi/3.
        assert report["energy_kept"] == pytest.approx((1 / 4 + 1 / 12) / (1 / 4 + 1 / 3), abs=1e-12)


@pytest.mark.parametrize("order", [2, 3, 5, 7, 10])
def test_auto_leaves_nothing_negative_and_no_more_than_needed(order, random, directions):
    light = ringing_light(random, order)
    windowed, report = sh.apply_window(light, "auto")
    assert report["minimum_before"] < 0 < report["strength"]
    assert abs(report["minimum_after"]) < 1e-9 * report["peak_after"]
    # On directions of the test's own, denser than the grid that the search starts from.
    axes = torch.nn.functional.normalize(random(20000, 3), dim=-1)
    values = sh.evaluate(windowed, torch.cat([axes, directions]))
    assert -1e-9 * values.max() < values.min() < 0.02 * values.max()
    bands = torch.arange(order)
    weaker = torch.exp(-0.99 * report["strength"] * bands * (bands + 1)).double()
    assert sh.sphere_minimum(light * weaker[sh.band_of_index(order)][:, None])[0] < -1e-8


def test_minimum_rises_with_strength(random):
    """What makes bisection right: the heat kernel is not negative, so more of it never lowers the minimum."""
    light, bands = random(64, 2), sh.band_of_index(8)
    minima = [
        sh.sphere_minimum(light * torch.exp(-s * bands * (bands + 1)).double()[:, None])[0]
        for s in torch.linspace(0, 0.3, 8, dtype=torch.float64)
    ]
    assert minima == sorted(minima)


def test_channels_share_one_window(random):
    light = ringing_light(random, 5)
    windowed, report = sh.apply_window(light, "auto")
    factors = torch.tensor(report["factors"]).double()[sh.band_of_index(5)]
    assert torch.allclose(windowed, light * factors[:, None], atol=1e-14)
    strengths = [sh.apply_window(light[:, c], "auto")[1]["strength"] for c in range(3)]
    assert report["strength"] == pytest.approx(max(strengths), rel=1e-8)


def test_positive_light_is_left_alone(dtype):
    light = torch.tensor([1.0, 0.2, -0.1, 0.3], dtype=dtype)[:, None].expand(4, 3)
    windowed, report = sh.apply_window(light, "auto")
    assert torch.equal(windowed, light) and windowed.dtype == dtype
    assert report["strength"] == 0 and report["contrast"] == 1 and report["energy_kept"] == 1


def test_black_light_and_black_channel(random):
    windowed, report = sh.apply_window(torch.zeros(9, 3), "auto")
    assert (windowed == 0).all() and report["contrast"] == 1 and report["energy_kept"] == 1
    light = ringing_light(random, 3) * torch.tensor([1.0, 0, 1.0])
    assert sh.apply_window(light, "auto")[1]["minimum_after"] == pytest.approx(0, abs=FLOAT64["twin"])


def test_windows_trade_contrast_and_report_it(random, dtype):
    light = ringing_light(random, 6).to(dtype)
    reports = {name: sh.apply_window(light, name)[1] for name in sh.WINDOWS}
    assert reports["none"]["contrast"] == 1 and reports["none"]["contrast_cost"] == 0
    assert 1 > reports["lanczos"]["contrast"] > reports["hann"]["contrast"] > 0
    for report in reports.values():
        assert report["minimum_after"] >= report["minimum_before"]
        assert report["contrast_cost"] == pytest.approx(1 - report["peak_after"] / report["peak_before"])
        assert all(isinstance(value, (str, float, list, type(None))) for value in report.values())


@pytest.mark.parametrize("name", ["none", "hann", "lanczos"])
def test_gradients_of_fixed_windows(name, random):
    light = ringing_light(random, 2)[:, :1].requires_grad_()
    assert torch.autograd.gradcheck(lambda c: sh.apply_window(c, name)[0], light)


def test_gradient_of_auto_includes_its_strength(random):
    # No mirror symmetry, so that one minimum alone decides and the strength is smooth in the coefficients.
    light = torch.cat([torch.ones(1, 2), random(3, 2)]).requires_grad_()
    assert sh.apply_window(light, "auto")[1]["strength"] > 0.01
    assert torch.autograd.gradcheck(lambda c: sh.apply_window(c, "auto")[0], light)


def test_sphere_minimum_of_known_functions(directions, dtype):
    """A linear function has its minimum opposite its gradient; z² at the equator; by channel."""
    axis = directions[31]
    linear = sh.rotate_zonal(torch.tensor([0.0, 1.0], dtype=torch.float64), axis)
    value, direction, channel = sh.sphere_minimum(linear[:, None].to(dtype))
    assert value == pytest.approx(-math.sqrt(3 / (4 * math.pi)), rel=FLOAT32["rounding"])
    assert torch.allclose(direction, -axis, atol=2e-6) and channel == 0
    squares = sh.project_function(lambda d: d.square() + torch.tensor([0.0, -0.5, 0.25]), 3)
    value, direction, channel = sh.sphere_minimum(squares)
    assert value == pytest.approx(-0.5, abs=FLOAT64["rounding"])
    assert channel == 1 and abs(direction[1].item()) < FLOAT32["rounding"]


@pytest.mark.parametrize(
    ("coefficients", "name", "message"),
    [
        (torch.ones(9, 3), "hamming", "unknown window 'hamming': choose one of none, hann, lanczos, auto"),
        (torch.tensor([-1.0, 0, 0, 0]), "auto", "channel 0 has mean -0.282"),
        (torch.tensor([[1.0, 0, 0, 0], [0.0, 1, 0, 0]]).T, "auto", "channel 1 has mean 0"),
        (torch.full((4, 3), torch.nan), "auto", "NaN"),
        (torch.ones(4, 3, 2), "hann", r"\[4, 3, 2\]"),
        (torch.ones(5, 3), "hann", "5 SH coefficients"),
    ],
)
def test_errors(coefficients, name, message):
    with pytest.raises(InputError, match=message):
        sh.apply_window(coefficients, name)


def test_auto_has_no_factors_without_a_light():
    with pytest.raises(InputError, match="depends on the light: use apply_window"):
        sh.window("auto", 3)
    with pytest.raises(InputError, match="unknown window 'box'"):
        sh.window("box", 3)
