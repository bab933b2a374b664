"""Coordinates of transfer in which squared distance is the mean squared error of radiance over lights and views.

Incident light of mean square P weighs columns by sqrt(P). Glossy transfer is looked at from above the surface only:
its rows, coefficients of exit radiance, are multiplied by the root of G = 1/pi ∫ y(d) y(d)ᵀ cos dω over the hemisphere,
seen area included. Errors that only show below the horizon cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.compression import GlossyAsset

# Least eigenvalue of G kept, as a share of the largest: coordinates are divided by its root.
_LEAST = 1e-3
_DIRECTIONS = 4096


@dataclass(frozen=True)
class Metric:
    """Scales signals [..., K], or [..., K_out, K] where `outgoing` is given.

    Attributes:
        incoming: float32 [K], roots of the light's prior.
        outgoing: float32 [K_out, K_out], the root of G, symmetric; None for diffuse transfer.
        inverse: of `outgoing`.
    """

    incoming: torch.Tensor
    outgoing: torch.Tensor | None = None
    inverse: torch.Tensor | None = None

    @staticmethod
    def of(asset, prior: torch.Tensor) -> Metric:
        """The metric for assets of this kind; `prior` [K] is the mean square of each light coefficient."""
        incoming = prior.to(torch.float32).sqrt()
        if not isinstance(asset, GlossyAsset):
            return Metric(incoming)
        index = torch.arange(_DIRECTIONS, dtype=torch.float64) + 0.5
        # A spiral of directions by falling height, evenly spread over cos dω.
        height, turn = (1 - index / _DIRECTIONS).sqrt(), index * torch.pi * (1 + 5**0.5)
        level = (1 - height.square()).sqrt()
        basis = sh.basis(torch.stack([level * turn.cos(), level * turn.sin(), height], dim=1), asset.order_out)
        values, axes = torch.linalg.eigh(basis.T @ basis / _DIRECTIONS)
        root = values.clamp_min(_LEAST * float(values.max())).sqrt()
        return Metric(incoming, ((axes * root) @ axes.T).float(), ((axes / root) @ axes.T).float())

    def scale(self, signal: torch.Tensor) -> torch.Tensor:
        """A signal in these coordinates; gradients reach it."""
        scaled = signal * self.incoming.to(signal.dtype)
        return scaled if self.outgoing is None else self.outgoing.to(signal.dtype) @ scaled

    def unscale(self, scaled: torch.Tensor) -> torch.Tensor:
        """What `scale` was given."""
        signal = scaled / self.incoming.to(scaled.dtype)
        return signal if self.inverse is None else self.inverse.to(scaled.dtype) @ signal
