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
from diffprt.brdf.parameter import Parameter, checked, of_dtype
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

    @classmethod
    def parameters(cls) -> tuple[str, ...]:
        return (*(name for name in super().parameters() if name != "fresnel"), "f0", "eta", "k")

    @classmethod
    def of(cls, **values: Parameter | str) -> Microfacet:
        fresnel = {key: values.pop(key) for key in ("f0", "eta", "k") if key in values}
        if "f0" in fresnel and len(fresnel) > 1:
            raise InputError("f0 stands beside eta or k: give f0 (Schlick), or eta and k (a metal)")
        if len(fresnel) == 1 and "f0" not in fresnel:
            raise InputError(f"{next(iter(fresnel))} stands alone: a metal has both eta and k")
        if fresnel:
            values["fresnel"] = Schlick(**fresnel) if "f0" in fresnel else Conductor(**fresnel)
        return cls(**values)

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


@dataclass(frozen=True)
class GGX(Microfacet):
    """Facets with the long tails of Trowbridge and Reitz.

    Source: Walter et al. 2007, eq. 33-35.
    """

    def distribution(self, slope_squared: torch.Tensor, cosine: torch.Tensor) -> torch.Tensor:
        a2 = of_dtype(self.roughness, cosine) ** 2
        return a2 / (math.pi * cosine.clamp_min(1e-8) ** 4 * (a2 + slope_squared) ** 2)

    def slope_squared(self, u: torch.Tensor) -> torch.Tensor:
        return of_dtype(self.roughness, u) ** 2 * u / (1 - u)

    def visible_share(self, slope_squared: torch.Tensor) -> torch.Tensor:
        return 2 / (1 + (1 + of_dtype(self.roughness, slope_squared) ** 2 * slope_squared).sqrt())


def _slope_squared(directions: torch.Tensor) -> torch.Tensor:
    """tan² of the angle to the normal; from x and y, because 1 - z² cancels near the normal."""
    x, y, z = directions.unbind(-1)
    return (x * x + y * y) / (z * z).clamp_min(1e-30)
