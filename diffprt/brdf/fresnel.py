"""Reflectance of a smooth facet, by the cosine between light and the facet's normal."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.brdf.parameter import Parameter, checked, of_dtype


@dataclass(frozen=True)
class Schlick:
    """F = f0 + (1 - f0)(1 - c)⁵.

    Attributes:
        f0: reflectance at normal incidence, [] or [3], in [0, 1]; 1 is a white facet.

    Source: Schlick, "An Inexpensive BRDF Model for Physically-Based Rendering" (1994), eq. 15.
    """

    f0: Parameter = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "f0", checked("f0", self.f0, 0.0, 1.0, "give values in [0, 1]", colors=True))

    @property
    def channels(self) -> int:
        """1 or 3."""
        return self.f0.numel()

    def __call__(self, cosine: torch.Tensor) -> torch.Tensor:
        """Reflectance [..., C] at `cosine` [...] in [0, 1]; gradients reach both."""
        f0 = of_dtype(self.f0, cosine).reshape(-1)
        return f0 + (1 - f0) * (1 - cosine.clamp(0, 1))[..., None] ** 5


@dataclass(frozen=True)
class Conductor:
    """Exact reflectance of unpolarized light at a metal in vacuum.

    Attributes:
        eta: real part of the index of refraction, [] or [3], in [0.01, 100].
        k: imaginary part (extinction), [] or [3], in [0, 100].

    Source: Born and Wolf, "Principles of Optics", section 14.2.
    """

    eta: Parameter
    k: Parameter

    def __post_init__(self) -> None:
        for name, low in (("eta", 0.01), ("k", 0.0)):
            value = checked(name, getattr(self, name), low, 100.0, f"give values in [{low:g}, 100]", colors=True)
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> int:
        """1 or 3."""
        return max(self.eta.numel(), self.k.numel())

    def __call__(self, cosine: torch.Tensor) -> torch.Tensor:
        """Reflectance [..., C] at `cosine` [...] in [0, 1]; gradients reach both."""
        eta, k = (of_dtype(p, cosine).reshape(-1) for p in (self.eta, self.k))
        c = cosine.clamp(0, 1)[..., None]
        c2, s2 = c * c, 1 - c * c
        t = eta * eta - k * k - s2
        # At eta = 1, k = 0 and grazing light the root is of 0: the floor keeps its gradient finite.
        a2_b2 = (t * t + 4 * eta * eta * k * k).clamp_min(1e-20).sqrt()
        a = ((a2_b2 + t) / 2).clamp_min(1e-20).sqrt()
        across = (a2_b2 + c2 - 2 * a * c) / (a2_b2 + c2 + 2 * a * c).clamp_min(1e-20)
        u, v = a2_b2 * c2 + s2 * s2, 2 * a * c * s2
        along = across * (u - v) / (u + v).clamp_min(1e-20)
        return (across + along) / 2
