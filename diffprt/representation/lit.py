"""A lit asset: coefficients of its elements, and the basis in which pixels read them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch

from diffprt.representation.view import Samples


class Basis(ABC):
    """B functions of what a pixel knows: point, normal and eye. Hashable, equal where its values are."""

    needs_eye: bool = False

    @abstractmethod
    def at(self, samples: Samples, eye: torch.Tensor | None) -> torch.Tensor:
        """Its values [N, B]; or [N, S, B], where they depend on the element that is seen.

        Args:
            samples: N points, elements counted as in the coefficients.
            eye: [3] or [N, 3], scene units; None where `needs_eye` is False and nobody looks.
        """


@dataclass(frozen=True)
class ConstantBasis(Basis):
    """One function, 1: what looks the same from everywhere and is constant, or interpolated, over elements."""

    def at(self, samples: Samples, eye: torch.Tensor | None) -> torch.Tensor:
        return samples.points.new_ones(len(samples.index), 1)


@dataclass(frozen=True)
class Lit:
    """Radiance as the sum of weight x coefficient x basis over what a sample sees.

    Attributes:
        coefficients: float [E, 3, B], linear radiance [W/m²/sr]; under several lights the colors of each in turn, and
            so in what is made of them. May carry gradients.
        basis: B functions.
    """

    coefficients: torch.Tensor
    basis: Basis

    def towards(self, samples: Samples, eye: torch.Tensor | None) -> torch.Tensor:
        """Radiance [N, 3] of samples towards `eye` ([3] or [N, 3]); gradients reach coefficients and eye."""
        values = self.basis.at(samples, eye).to(self.coefficients.dtype)
        if values.dim() == 2:
            return torch.einsum("ncb,nb->nc", samples.mixed(self.coefficients), values)
        weight = samples.weight.to(values.dtype)
        return torch.einsum("ns,nscb,nsb->nc", weight, self.coefficients[samples.index], values)
