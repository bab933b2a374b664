"""The Lambertian BRDF: albedo / π."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch

from diffprt.brdf.interface import Brdf
from diffprt.brdf.local import cosine_pdf, cosine_sample
from diffprt.brdf.parameter import Parameter


@dataclass(frozen=True)
class Lambert(Brdf):
    """Equal radiance in every direction; `diffuse` is its albedo. Reciprocal and energy-conserving."""

    diffuse: Parameter = 0.8
    specular: Parameter = field(default=0.0, init=False, repr=False)

    @property
    def width(self) -> float:
        return math.pi / 2

    def lobe(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        return torch.zeros_like(incoming[..., :1])

    def sample_lobe(self, outgoing: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        return cosine_sample(u)

    def lobe_pdf(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        return cosine_pdf(incoming)
