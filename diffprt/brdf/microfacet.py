"""Microfacet lobes D F G / (4 cos θ_i cos θ_o): a distribution of mirrors, of which some hide others.

Source: Cook and Torrance, "A Reflectance Model for Computer Graphics" (TOG 1982), with the factor 4 in place of
their π, as derived by Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (EGSR 2007), eq. 20.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field

import torch

from diffprt.brdf.fresnel import Conductor, Schlick
from diffprt.brdf.interface import Brdf
from diffprt.brdf.local import half_vector
from diffprt.brdf.parameter import Parameter, checked
from diffprt.errors import InputError

MINIMUM_ROUGHNESS = 1e-3
MASKINGS = ("v-cavity", "smith")


@dataclass(frozen=True)
class Microfacet(Brdf):
    """What Cook-Torrance and GGX share. Reciprocal; never gains energy (multiple scattering is left out).

    Attributes:
        roughness: in [0.001, 1]: root mean square slope times √2 (Beckmann's m), or α of GGX. Not squared.
        fresnel: `Schlick` or `Conductor`.
        masking: "v-cavity" (Cook and Torrance 1982, eq. 2) or "smith" (Walter et al. 2007, eq. 23, separable).

    Raises:
        InputError: roughness 0, which is a mirror, or another parameter out of range.
    """

    roughness: Parameter = 0.3
    fresnel: Schlick | Conductor = field(default_factory=Schlick, kw_only=True)
    masking: str = field(default="smith", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        remedy = f"give {MINIMUM_ROUGHNESS:g} to 1; roughness 0 is a mirror, which harmonics cannot hold"
        value = checked("roughness", self.roughness, MINIMUM_ROUGHNESS, 1.0, remedy)
        object.__setattr__(self, "roughness", value)
        if self.masking not in MASKINGS:
            raise InputError(f"masking '{self.masking}' is unknown: use one of {', '.join(MASKINGS)}")

    @property
    def channels(self) -> int:
        return max(super().channels, self.fresnel.channels)

    @property
    def width(self) -> float:
        return float(self.roughness.detach())

    @abstractmethod
    def distribution(self, slope_squared: torch.Tensor, cosine: torch.Tensor) -> torch.Tensor:
        """D [1/sr] of facet normals, from tan² and cosine of their angle to the normal."""

    @abstractmethod
    def slope_squared(self, u: torch.Tensor) -> torch.Tensor:
        """tan² of facet normals distributed like D times their cosine, from `u` in [0, 1)."""

    @abstractmethod
    def visible_share(self, slope_squared: torch.Tensor) -> torch.Tensor:
        """Smith's G1 for directions with this tan² to the normal."""

    def lobe(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        h = half_vector(incoming, outgoing)
        cosine_h = (outgoing * h).sum(-1)
        cosine_i, cosine_o = incoming[..., 2], outgoing[..., 2]
        if self.masking == "smith":
            shown = self.visible_share(_slope_squared(incoming)) * self.visible_share(_slope_squared(outgoing))
        else:
            least = torch.minimum(cosine_i, cosine_o)
            shown = (2 * h[..., 2] * least / cosine_h.clamp_min(1e-20)).clamp_max(1.0)
        facets = self.distribution(_slope_squared(h), h[..., 2]) * shown / (4 * cosine_i * cosine_o)
        return facets[..., None] * self.fresnel(cosine_h)

    def sample_lobe(self, outgoing: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        slope = self.slope_squared(u[..., 0]).sqrt()
        cosine, angle = (1 + slope * slope).rsqrt(), 2 * math.pi * u[..., 1]
        h = torch.stack([slope * cosine * angle.cos(), slope * cosine * angle.sin(), cosine], dim=-1)
        return 2 * (outgoing * h).sum(-1, keepdim=True) * h - outgoing

    def lobe_pdf(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        h = half_vector(incoming, outgoing)
        facets = self.distribution(_slope_squared(h), h[..., 2]) * h[..., 2]
        return facets / (4 * (outgoing * h).sum(-1).abs()).clamp_min(1e-20)


def _slope_squared(directions: torch.Tensor) -> torch.Tensor:
    """tan² of the angle to the normal; from x and y, because 1 - z² cancels near the normal."""
    x, y, z = directions.unbind(-1)
    return (x * x + y * y) / (z * z).clamp_min(1e-30)
