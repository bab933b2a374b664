"""The BRDFs that the laws are tried on."""

import pytest
import torch

from diffprt.brdf import GGX, Conductor, CookTorrance, Lambert, ModifiedPhong, Phong, Schlick

RECIPROCAL = {
    "lambert": Lambert(0.7),
    "modified phong 0": ModifiedPhong(0.0),
    "modified phong 16": ModifiedPhong(16.0, diffuse=0.3, specular=0.6),
    "cook-torrance 0.3": CookTorrance(0.3, fresnel=Schlick(0.2)),
    "cook-torrance smith": CookTorrance(0.5, masking="smith", fresnel=Conductor((0.2, 0.9, 1.3), (3.9, 2.4, 2.2))),
    "ggx 0.4": GGX(0.4, diffuse=(0.1, 0.2, 0.3), specular=0.5),
    "ggx v-cavity": GGX(0.2, masking="v-cavity"),
}
ALL = {**RECIPROCAL, "phong 16": Phong(16.0, diffuse=0.2, specular=0.7)}


@pytest.fixture(params=ALL.values(), ids=ALL.keys())
def brdf(request):
    return request.param


@pytest.fixture(params=RECIPROCAL.values(), ids=RECIPROCAL.keys())
def reciprocal(request):
    return request.param


@pytest.fixture
def upper(generator) -> torch.Tensor:
    """Directions [64, 3] of the upper hemisphere, float64."""
    directions = torch.nn.functional.normalize(torch.randn(64, 3, dtype=torch.float64, generator=generator), dim=-1)
    return directions * torch.where(directions[:, 2:] < 0, -1.0, 1.0)
