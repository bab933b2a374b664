"""Squared error of transfer as pictures under random lights show it, against uncompressed transfer."""

from __future__ import annotations

import torch

from diffprt.compression import ClusteredSignal
from diffprt.compression.clusters.blend import blend
from diffprt.errors import InputError
from diffprt.optimization.image_norm import ImageNorm
from diffprt.optimization.metric import Metric
from diffprt.transfer import GlossyTransfer, Transfer


def signal_of(asset: Transfer | GlossyTransfer) -> torch.Tensor:
    """The signal [V, C, ..., K] of uncompressed transfer.

    Raises:
        InputError: it is compressed.
    """
    if not isinstance(asset, Transfer | GlossyTransfer):
        raise InputError("the target is compressed: give the uncompressed transfer that 'diffprt bake' made")
    return asset.glossy if isinstance(asset, GlossyTransfer) else asset.diffuse


class TransferLoss:
    """The expected squared error of a picture over its expected energy (`ImageNorm`), closed form and differentiable.

    Args:
        target: uncompressed transfer.
        norm: over views.
        prior: float [K], mean square of each light coefficient.

    Attributes:
        metric: in which signals are compared.
        signal: the target's, [V, C, ..., K].
        target: the same in that metric, times the reflectance, [V, D].
        energy: of its pictures.
    """

    def __init__(self, target: Transfer | GlossyTransfer, norm: ImageNorm, prior: torch.Tensor) -> None:
        signal = signal_of(target).detach()
        self.norm, self.shape, self.signal = norm, signal.shape, signal
        self.metric, self.reflectance = Metric.of(target, prior), _reflectance(target).to(signal.dtype)
        self.target = self._compared(signal)
        self.energy = float(norm.squared(self.target))
        if not self.energy > 0:
            raise InputError("the target is black wherever it is seen: bake it again")

    def check(self, asset) -> None:
        """Raises InputError unless `asset` has the target's receivers and coefficients."""
        means = getattr(asset, "means", None)
        shape = tuple(signal_of(asset).shape[1:]) if means is None else tuple(means.shape[1:])
        if (len(asset.receivers), *shape) != tuple(self.shape):
            raise InputError(
                f"the target's signal is {list(self.shape)}, the asset's {[len(asset.receivers), *shape]}: give the "
                "transfer that the asset was compressed from"
            )

    def scaled(self, asset) -> torch.Tensor:
        """The asset's rows [V, D] in the target's scale."""
        if not isinstance(asset, ClusteredSignal):
            return self._compared(signal_of(asset))
        means, bases = self.metric.scale(asset.means), self.metric.scale(asset.bases)
        return (self.reflectance * blend(asset.labels, asset.weights, means, bases)).flatten(1)

    def _compared(self, signal: torch.Tensor) -> torch.Tensor:
        return (self.metric.scale(signal) * self.reflectance).flatten(1)

    def __call__(self, asset) -> torch.Tensor:
        """A scalar, the square of the relative RMSE to expect; gradients reach the asset's signal."""
        return self.norm.squared(self.scaled(asset) - self.target) / self.energy


def _reflectance(target: Transfer | GlossyTransfer) -> torch.Tensor:
    """What each row's error is multiplied by in pictures: [V, C, 1] for diffuse transfer, 1 for glossy.

    One channel serves three colors, whose squared errors add up.
    """
    if isinstance(target, GlossyTransfer):
        return torch.ones(())
    albedo = target.receivers.albedo.detach()
    if target.channels == 1:
        albedo = albedo.square().mean(1, keepdim=True).sqrt()
    return albedo[..., None]
