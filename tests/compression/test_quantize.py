"""Few bits: bounds, bytes, and gradients through rounding (hard case 20)."""

import pytest
import torch
from tolerances import FLOAT32

from diffprt.compression import dequantize, quantize, rounded
from diffprt.errors import InputError


def test_uint8_is_within_half_a_step_of_its_range(generator):
    weights = torch.randn(500, 6, generator=generator) * torch.tensor([1e-4, 1, 10, 1e3, 1, 1]) + 5
    labels = torch.randint(0, 9, (500,), generator=generator)
    stored = quantize(weights, "uint8", ranges=labels)
    error = (dequantize(stored, ranges=labels) - weights).abs()
    assert stored.codes.dtype == torch.uint8 and stored.steps.shape == (9, 6)
    rounding = 4 * torch.finfo(torch.float32).eps * weights.abs()
    assert bool((error <= 0.5 * stored.steps[labels] + rounding).all())
    for m in range(9):  # both ends of each range are there
        own = weights[labels == m]
        back = dequantize(stored, ranges=labels)[labels == m]
        assert torch.allclose(back.amin(0), own.amin(0)) and torch.allclose(back.amax(0), own.amax(0))


def test_float16_is_within_half_a_unit_in_the_last_place(generator):
    values = torch.randn(300, 4, generator=generator)
    error = (rounded(values, "float16") - values).abs()
    assert bool((error <= values.abs() * 2.0**-11 + 2.0**-25).all())
    with pytest.raises(InputError, match="100000 is beyond float16's 65504"):
        quantize(torch.full((2, 2), 1e5), "float16")


def test_zero_range_is_exact():
    """Constant columns, a cluster of one, and zeros: nothing is divided by zero."""
    weights = torch.tensor([[3.0, 0.0], [3.0, 0.0], [7.0, -2.0]])
    assert torch.equal(rounded(weights, "uint8", ranges=torch.tensor([0, 0, 1])), weights)
    assert torch.equal(rounded(torch.zeros(2, 3, 5), "uint8"), torch.zeros(2, 3, 5))
    assert rounded(torch.zeros(4, 0), "uint8", ranges=torch.zeros(4, dtype=torch.int64)).shape == (4, 0)


def test_bases_have_a_range_per_component(generator):
    bases = torch.randn(4, 3, 2, 9, generator=generator)
    stored = quantize(bases, "uint8")
    assert stored.codes.shape == bases.shape and stored.offsets.shape == (4, 3)
    step = (bases.amax((2, 3)) - bases.amin((2, 3))) / 255
    assert bool(((dequantize(stored) - bases).abs() <= 0.51 * step[..., None, None]).all())


@pytest.mark.parametrize("format", ["float32", "float16", "uint8"])
def test_rounding_twice_is_rounding_once(format, generator):
    """What a loaded asset holds is stored as it was."""
    values = torch.randn(100, 4, generator=generator)
    labels = torch.randint(0, 5, (100,), generator=generator)
    once = rounded(values, format, ranges=labels)
    assert torch.allclose(rounded(once, format, ranges=labels), once, atol=FLOAT32["rounding"])
    if format == "uint8":
        codes = [quantize(v, format, ranges=labels).codes for v in (values, once)]
        assert torch.equal(*codes)


@pytest.mark.parametrize("format", ["float32", "float16", "uint8"])
def test_gradients_pass_straight_through(format, generator):
    values = torch.randn(20, 3, generator=generator, requires_grad=True)
    out = rounded(values, format)
    assert torch.allclose(out.detach(), rounded(values.detach(), format))
    out.square().sum().backward()
    assert torch.allclose(values.grad, 2 * out.detach())


def test_bytes_are_those_of_the_codes(generator):
    values = torch.randn(100, 4, generator=generator)
    labels = torch.randint(0, 5, (100,), generator=generator)
    labels[0] = 4
    assert quantize(values, "float32").nbytes == 1600
    assert quantize(values, "float16").nbytes == 800
    assert quantize(values, "uint8", ranges=labels).nbytes == 400 + 2 * 4 * 5 * 4


def test_unknown_format_is_named():
    with pytest.raises(InputError, match="format is 'int4': use one of float32, float16, uint8"):
        quantize(torch.rand(2, 2), "int4")
