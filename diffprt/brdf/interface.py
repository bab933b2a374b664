"""The one interface of BRDFs: a diffuse part and a specular lobe, isotropic, in the local frame (z is the normal).

rho(w_i, w_o) = diffuse / π + specular · lobe(w_i, w_o) above the surface, 0 below. Directions point away from the
surface. The cosine is not included.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields

import torch

from diffprt.brdf.local import cosine_pdf, cosine_sample
from diffprt.brdf.parameter import Parameter, checked, of_dtype
from diffprt.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Brdf(ABC):
    """A BRDF; its subclasses, frozen dataclasses, differ in the lobe and its parameters.

    Attributes:
        diffuse: linear reflectance of the Lambertian part, [] or [3], in [0, 1].
        specular: weight of the lobe, [] or [3], in [0, 1].

    Gradients reach the weights and the parameters of the lobe.

    Raises:
        InputError: a weight outside [0, 1], or weights that together exceed 1.
    """

    diffuse: Parameter = 0.0
    specular: Parameter = 1.0

    def __post_init__(self) -> None:
        for name in ("diffuse", "specular"):
            value = checked(f"{name} weight", getattr(self, name), 0.0, 1.0, "give values in [0, 1]", colors=True)
            object.__setattr__(self, name, value)
        total = (self.diffuse.detach() + self.specular.detach()).max()
        if float(total) > 1 + 1e-6:
            raise InputError(f"diffuse and specular weights add up to {float(total):.4g}: lower them to at most 1")

    @classmethod
    def parameters(cls) -> tuple[str, ...]:
        """Names of what `of` takes and descriptions record: the fields of the dataclass."""
        return tuple(f.name for f in fields(cls) if f.init)

    @classmethod
    def of(cls, **values: Parameter | str) -> Brdf:
        """The BRDF with these parameters; those left out have their defaults. Raises InputError as the class does."""
        return cls(**values)

    @property
    def channels(self) -> int:
        """1 when nothing colors the light, else 3."""
        return max(self.diffuse.numel(), self.specular.numel())

    @property
    @abstractmethod
    def width(self) -> float:
        """Angle [radians] within which the lobe changes; quadrature puts its nodes accordingly."""

    @abstractmethod
    def lobe(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        """The lobe [..., 1] or [..., 3] for directions [..., 3] that lie above the surface."""

    @abstractmethod
    def sample_lobe(self, outgoing: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Incoming directions [..., 3] distributed like the lobe, from `u` [..., 2] in [0, 1)."""

    @abstractmethod
    def lobe_pdf(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        """Density [...] of `sample_lobe` [1/sr]."""

    def evaluate(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        """rho [1/sr], without cosine.

        Args:
            incoming, outgoing: float [..., 3], unit, away from the surface, local frame.
        Returns:
            [..., C], C = `channels`, in the dtype of the directions; 0 where either lies below the surface.
            Gradients reach directions and parameters.
        """
        above = ((incoming[..., 2] > 0) & (outgoing[..., 2] > 0))[..., None]
        # Below, the lobe is evaluated at the normal instead, so that no gradient is NaN times 0.
        normal = incoming.new_tensor([0.0, 0.0, 1.0])
        lobe = self.lobe(torch.where(above, incoming, normal), torch.where(above, outgoing, normal))
        diffuse, specular = (of_dtype(w, incoming).reshape(-1) for w in (self.diffuse, self.specular))
        return torch.where(above, diffuse / math.pi + specular * lobe, 0.0)

    def sample(self, outgoing: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Incoming directions for importance sampling, without gradients.

        Args:
            outgoing: float [..., 3].
            u: float [..., 2], uniform in [0, 1).
        Returns:
            [..., 3]. Some of the lobe may lie below the surface, where rho is 0.
        """
        share = self._specular_share
        if share == 0:
            return cosine_sample(u)
        with torch.no_grad():
            first, second = u.unbind(-1)
            lobe = self.sample_lobe(outgoing, torch.stack([(first / share).clamp_max(1 - 1e-7), second], dim=-1))
            if share == 1:
                return lobe
            rest = ((first - share) / (1 - share)).clamp(0, 1 - 1e-7)
            diffuse = cosine_sample(torch.stack([rest, second], dim=-1))
            return torch.where((first < share)[..., None], lobe, diffuse)

    def pdf(self, incoming: torch.Tensor, outgoing: torch.Tensor) -> torch.Tensor:
        """Density [...] of `sample` over the whole sphere [1/sr]; integrates to 1."""
        share = self._specular_share
        lobe = self.lobe_pdf(incoming, outgoing) if share > 0 else 0.0
        return share * lobe + (1 - share) * cosine_pdf(incoming)

    @property
    def _specular_share(self) -> float:
        """Probability of sampling the lobe."""
        diffuse, specular = float(self.diffuse.detach().mean()), float(self.specular.detach().mean())
        return specular / (diffuse + specular) if specular > 0 else 0.0


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
