"""Coordinates of transfer in which squared distance is the mean squared error of radiance over lights and views.

Incident light of mean square P weighs columns by sqrt(P). Glossy transfer is looked at from above the surface only:
its rows, coefficients of exit radiance, are multiplied by the root of G = 1/pi ∫ y(d) y(d)ᵀ cos dω over the hemisphere,
seen area included. Errors that only show below the horizon cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

# Least eigenvalue of G kept, as a share of the largest: coordinates are divided by its root.
_LEAST = 1e-3


@dataclass(frozen=True)
class Metric:
    """Scales signals [..., K], or [..., K_out, K] where `outgoing` is given; leaves them as they are without either.

    Attributes:
        incoming: float32 [K], roots of the light's prior; None where the signal has no axis of light.
        outgoing: float32 [K_out, K_out], the root of G, symmetric; None for diffuse transfer.
        inverse: of `outgoing`.
    """

    incoming: torch.Tensor | None = None
    outgoing: torch.Tensor | None = None
    inverse: torch.Tensor | None = None

    @staticmethod
    def of(prior: torch.Tensor, outgoing: torch.Tensor | None = None) -> Metric:
        """The metric for lights of mean square `prior` [K]; `outgoing` is G [K_out, K_out], where there are rows."""
        incoming = prior.to(torch.float32).sqrt()
        if outgoing is None:
            return Metric(incoming)
        values, axes = torch.linalg.eigh(outgoing)
        root = values.clamp_min(_LEAST * float(values.max())).sqrt()
        return Metric(incoming, ((axes * root) @ axes.T).float(), ((axes / root) @ axes.T).float())

    def scale(self, signal: torch.Tensor) -> torch.Tensor:
        """A signal in these coordinates; gradients reach it."""
        scaled = signal if self.incoming is None else signal * self.incoming.to(signal.dtype)
        return scaled if self.outgoing is None else self.outgoing.to(signal.dtype) @ scaled

    def unscale(self, scaled: torch.Tensor) -> torch.Tensor:
        """What `scale` was given."""
        signal = scaled if self.incoming is None else scaled / self.incoming.to(scaled.dtype)
        return signal if self.inverse is None else self.inverse.to(scaled.dtype) @ signal
