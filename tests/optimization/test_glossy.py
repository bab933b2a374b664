"""Clustered glossy transfer is trained as diffuse transfer is, in the metric of what is seen above the horizon."""

import pytest
import torch

from diffprt import sh
from diffprt.brdf import parse_brdf
from diffprt.compression import ClusteredGlossyTransfer, compress
from diffprt.optimization import make_references, optimize
from diffprt.representation.file_size import size_in_file
from diffprt.scene import builtin_environment
from diffprt.transfer import bake_glossy


@pytest.fixture(scope="module")
def glossy(bumpy):
    return bake_glossy(bumpy, parse_brdf("phong:exponent=8"), order=3, rays=64)


def test_the_metric_is_radiance_over_the_hemisphere(glossy, generator):
    metric = glossy.metric(torch.ones(9))
    signal = torch.randn(1, 9, 9, generator=generator)
    turn = torch.randn(40000, 3, generator=generator, dtype=torch.float64)
    # Cosine-distributed directions: uniform on the sphere, moved up by one.
    away = torch.nn.functional.normalize(torch.nn.functional.normalize(turn, dim=1) + torch.tensor([0.0, 0, 1]), dim=1)
    seen = sh.basis(away, 3).float() @ signal[0]
    # 40000 directions leave about 1 %; what is clamped of G is below a thousandth of it.
    assert float(metric.scale(signal).square().sum() / seen.square().sum(1).mean()) == pytest.approx(1, abs=0.03)
    assert torch.allclose(metric.unscale(metric.scale(signal)), signal, atol=1e-4)


def test_glossy_pictures_improve_and_fit_a_budget(glossy):
    small = compress(glossy, clusters=4, components=2, method="lbg")
    lights = [builtin_environment(name).project(3) for name in ("sky", "studio")]
    references = make_references(glossy, lights, 10, width=40, height=40)
    report: dict = {}
    better = optimize(small, references, target=glossy, steps=40, report=report)
    assert isinstance(better, ClusteredGlossyTransfer)
    assert report["errors"]["after"] < 0.95 * report["errors"]["before"]
    size = size_in_file(small)
    fitted = optimize(small, references, target=glossy, bytes=size, geometry=32, steps=10, report=report)
    assert 0.9 * size < size_in_file(fitted) <= size and report["errors"]["after"] < 0.6 * report["errors"]["before"]
