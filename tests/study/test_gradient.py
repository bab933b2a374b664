"""The study of gradients: ours and Mitsuba's point the same way on a small picture."""

import pytest
import torch

from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.rendering import FrozenView
from diffprt.scene import Camera, builtin_environment
from diffprt.study.gradient.mitsuba import MitsubaGradient
from diffprt.study.gradient.steps import gradient_steps
from diffprt.study.gradient.study import compared, gradient_study


def test_gradients_agree_with_mitsuba(bumpy, bumpy_transfer):
    pytest.importorskip("mitsuba")
    light = builtin_environment("sky").project(4, window="auto")
    camera = Camera.framing(bumpy_transfer.receivers.positions, width=32, height=32)
    frozen = FrozenView.of(bumpy_transfer.receivers, camera, samples=4)
    clustered = compress(bumpy_transfer, clusters=4, components=2)
    reference = torch.zeros(32, 32, 3)
    reference[8:, 16:] = torch.tensor([0.3, 0.2, 0.1])
    steps = gradient_steps(bumpy_transfer, clustered, frozen, light, reference[frozen.mask], rows=8)
    found = {name: step() for name, step in steps.items()}
    assert all(float(gradient.norm()) > 0 for gradients in found.values() for gradient in gradients)
    fine = MitsubaGradient(bumpy, camera, light, bounces=1, rows=64)
    target = fine.reference(reference * frozen.mask[..., None])
    theirs = [fine.to_bands(target, 4, samples=64, seed=seed) for seed in (0, 1)]
    cosine = compared(found["light"][0].double(), theirs)
    # 128 rays per receiver; 64 paths per pixel.
    assert cosine["overall"] > 0.99 and cosine["between_halves"] > 0.99
    assert abs(cosine["length_ratio"] - 1) < 0.1


def test_cosine_is_by_band(generator):
    gradient = torch.randn(9, 3, dtype=torch.float64, generator=generator)
    turned = gradient.clone()
    turned[4:] *= -2
    found = compared(gradient, [turned, turned])
    assert found["bands"] == pytest.approx([1, 1, -1])
    assert -1 < found["overall"] < 1 and found["between_halves"] == pytest.approx(1)


def test_bad_options_are_named():
    with pytest.raises(InputError, match="halves is 1: give 2 or more"):
        gradient_study("builtin:bowl", halves=1)
