"""The Cook-Torrance BRDF: Beckmann's distribution of slopes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch

from diffprt.brdf.microfacet import Microfacet
from diffprt.brdf.parameter import of_dtype


@dataclass(frozen=True)
class CookTorrance(Microfacet):
    """Facets with Gaussian slopes; as published, they hide each other in V-shaped grooves.

    Source: Cook and Torrance 1982; sampling and Smith's term: Walter et al. 2007, eq. 28 and Heitz 2014, eq. 69.
    """

    masking: str = field(default="v-cavity", kw_only=True)

    def distribution(self, slope_squared: torch.Tensor, cosine: torch.Tensor) -> torch.Tensor:
        m2 = of_dtype(self.roughness, cosine) ** 2
        return (-slope_squared / m2).exp() / (math.pi * m2 * cosine.clamp_min(1e-8) ** 4)

    def slope_squared(self, u: torch.Tensor) -> torch.Tensor:
        return -(of_dtype(self.roughness, u) ** 2) * torch.log1p(-u)

    def visible_share(self, slope_squared: torch.Tensor) -> torch.Tensor:
        # a is 1 / (m tan θ); beyond 6 nothing is hidden to the last bit of float64.
        a = (of_dtype(self.roughness, slope_squared) ** 2 * slope_squared).clamp_min(1 / 36).rsqrt()
        hidden = (a.square().neg().exp() / (a * math.sqrt(math.pi)) - torch.erfc(a)) / 2
        return 1 / (1 + hidden)
