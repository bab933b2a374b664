"""Thin translucent surfaces: sheets that send part of what they reflect out on their other side.

Of the light E on its front and E' on its back, a sheet of transmission t sends out on its front

    L = albedo / pi ((1 - t) E + t E')

and with E and E' exchanged on its back; both together are the albedo's share of what arrives. So the front's transfer
is T = (1 - t) T_front + t T_back, where T_back is traced from the other side: in direct transfer, and row by row in
the bounce operator, so that interreflection, its solve and its gradients are those of opaque surfaces.

Not modeled is what others see of the back: a ray that hits a back is absorbed, on translucent surfaces as on all others
(it carries some light in truth, never a negative amount: results err on the dark side). A sheet that is to light what
lies behind it needs faces on both sides.

Source: glTF extension KHR_materials_diffuse_transmission, with the base color as the color of transmission.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.surface.receivers import Receivers


@dataclass(frozen=True)
class Sides:
    """The fronts of all receivers, and behind them the backs of those that are translucent.

    Attributes:
        traced: V + B receivers; backs have the opposite normal, and their faces are turned over.
        fronts: V.
        sheets: int64 [B], the front that each back belongs to.
        through: float64 [B] in (0, 1], transmission.
    """

    traced: Receivers
    fronts: int
    sheets: torch.Tensor
    through: torch.Tensor

    @staticmethod
    def of(receivers: Receivers) -> Sides | None:
        """The sides of `receivers`; None where all are opaque."""
        if receivers.transmission is None or not bool(receivers.transmission.any()):
            return None
        count, sheets = len(receivers), receivers.transmission.nonzero()[:, 0]
        back = torch.full((count,), -1)
        back[sheets] = count + torch.arange(len(sheets))
        turned = back[receivers.faces].flip(1)
        traced = Receivers(
            torch.cat([receivers.positions, receivers.positions[sheets]]),
            torch.cat([receivers.normals, -receivers.normals[sheets]]),
            torch.cat([receivers.albedo, receivers.albedo[sheets]]),
            torch.cat([receivers.faces, turned[(turned >= 0).all(1)]]),
        )
        return Sides(traced, count, sheets, receivers.transmission[sheets].double())

    def combined(self, signal: torch.Tensor) -> torch.Tensor:
        """What the fronts answer with, [V, ...], from the `signal` of all sides [V + B, ...]; without gradients."""
        through = self._shaped(signal)
        fronts = signal[: self.fronts].clone()
        fronts[self.sheets] = (1 - through) * fronts[self.sheets] + through * signal[self.fronts :]
        return fronts

    def combined_error(self, error: torch.Tensor) -> torch.Tensor:
        """As `combined`, for independent standard errors."""
        through = self._shaped(error)
        fronts = error[: self.fronts].clone()
        own, other = (1 - through) * fronts[self.sheets], through * error[self.fronts :]
        fronts[self.sheets] = (own.square() + other.square()).sqrt()
        return fronts

    def spread(self, signal: torch.Tensor) -> torch.Tensor:
        """The transpose of `combined`: [V, ...] to [V + B, ...]."""
        through = self._shaped(signal)
        fronts = signal.clone()
        fronts[self.sheets] = (1 - through) * signal[self.sheets]
        return torch.cat([fronts, through * signal[self.sheets]])

    def _shaped(self, signal: torch.Tensor) -> torch.Tensor:
        return self.through.to(signal.dtype).reshape(-1, *[1] * (signal.ndim - 1))
