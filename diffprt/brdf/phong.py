"""Phong's cosine lobe about the mirror direction, as he wrote it and made to conserve energy.

| | lobe | reciprocal | albedo at most 1 |
|---|---|---|---|
| `Phong` | (n+1)/2π · cosⁿα / cos θ_i | no | no: it grows like 1/cos θ_i |
| `ModifiedPhong` | (n+2)/2π · cosⁿα | yes | yes |

Phong adds ks cosⁿα to what a light contributes without the light's cosine; as a BRDF that is a division by it. The
factor (n+1)/2π gives the whole lobe the integral 1, so that `specular` means the same at every exponent.

Source: Phong, "Illumination for Computer Generated Pictures" (CACM 1975); Lafortune and Willems, "Using the Modified
Phong Reflectance Model for Physically Based Rendering" (1994), eq. 3 and 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt.brdf.interface import Brdf
from diffprt.brdf.local import about, mirrored
from diffprt.brdf.parameter import Parameter, checked, of_dtype

MAXIMUM_EXPONENT = 1e6


@dataclass(frozen=True)
class ModifiedPhong(Brdf):
    """Energy-conserving, reciprocal Phong.

    Attributes:
        exponent: n in [0, 1e6]; 0 is even over the hemisphere about the mirror direction.
    """

    exponent: Parameter = 16.0

    def __post_init__(self) -> None:
        super().__post_init__()
        remedy = f"give 0 to {MAXIMUM_EXPONENT:g}; a sharper lobe is a mirror"
        object.__setattr__(self, "exponent", checked("exponent", self.exponent, 0.0, MAXIMUM_EXPONENT, remedy))

    @property
    def width(self) -> float:
        return 1 / math.sqrt(1 + float(self.exponent.detach()) / 2)

    def lobe(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        n = of_dtype(self.exponent, incoming)
        return ((n + 2) / (2 * math.pi) * self._power(incoming, outgoing))[..., None]

    def sample_lobe(self, outgoing: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        n = of_dtype(self.exponent, outgoing)
        cosine = (1 - u[..., 0]) ** (1 / (n + 1))
        return about(mirrored(outgoing), cosine, 2 * math.pi * u[..., 1])

    def lobe_pdf(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        n = of_dtype(self.exponent, incoming)
        return (n + 1) / (2 * math.pi) * self._power(incoming, outgoing)

    def _power(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        """cosⁿα, or 0 beyond 90 degrees.

        1 - cos α is found from the chord: a dot product near 1 would lose the lobe of large exponents to rounding.
        """
        chord = mirrored(outgoing) - incoming
        fall = (chord * chord).sum(-1) / 2
        inside = fall < 1
        log_cosine = torch.log1p(-torch.where(inside, fall, 0.0))
        return torch.where(inside, (of_dtype(self.exponent, incoming) * log_cosine).exp(), 0.0)


@dataclass(frozen=True)
class Phong(ModifiedPhong):
    """Phong's model of 1975: neither reciprocal nor energy-conserving at grazing light."""

    def lobe(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        return self.lobe_pdf(incoming, outgoing)[..., None] / incoming[..., 2:]
