"""The GGX BRDF: the distribution of Trowbridge and Reitz, with long tails."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt.brdf.microfacet import Microfacet
from diffprt.brdf.parameter import of_dtype


@dataclass(frozen=True)
class GGX(Microfacet):
    """Facets of GGX.

    Source: Walter et al. 2007, eq. 33-35.
    """

    def distribution(self, slope_squared: torch.Tensor, cosine: torch.Tensor) -> torch.Tensor:
        a2 = of_dtype(self.roughness, cosine) ** 2
        return a2 / (math.pi * cosine.clamp_min(1e-8) ** 4 * (a2 + slope_squared) ** 2)

    def slope_squared(self, u: torch.Tensor) -> torch.Tensor:
        return of_dtype(self.roughness, u) ** 2 * u / (1 - u)

    def visible_share(self, slope_squared: torch.Tensor) -> torch.Tensor:
        return 2 / (1 + (1 + of_dtype(self.roughness, slope_squared) ** 2 * slope_squared).sqrt())
