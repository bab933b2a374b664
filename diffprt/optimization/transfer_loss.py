"""Squared error of transfer as pictures under random lights show it, against uncompressed transfer."""

from __future__ import annotations

from functools import singledispatch

import torch

from diffprt.compression import ClusteredSignal
from diffprt.compression.clusters.components import blend
from diffprt.errors import InputError
from diffprt.optimization.image_norm import ImageNorm
from diffprt.representation import Representation
from diffprt.representation.metric import Metric
from diffprt.transfer.at_receivers import TransferAtReceivers


@singledispatch
def scaled_rows(asset: Representation, metric: Metric) -> torch.Tensor:
    """The signal of an asset in a metric, [V, ...]; gradients reach it."""
    return metric.scale(asset.signal)


@scaled_rows.register
def _(asset: ClusteredSignal, metric: Metric) -> torch.Tensor:
    return blend(asset.labels, asset.weights, metric.scale(asset.means), metric.scale(asset.bases))


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

    def __init__(self, target: TransferAtReceivers, norm: ImageNorm, prior: torch.Tensor) -> None:
        signal = target.signal.detach()
        self.norm, self.shape, self.signal = norm, signal.shape, signal
        self.metric, self.reflectance = target.metric(prior), target.picture_weights.to(signal.dtype)
        self.target = self._compared(self.metric.scale(signal))
        self.energy = float(norm.squared(self.target))
        if not self.energy > 0:
            raise InputError("the target is black wherever it is seen: bake it again")

    def check(self, asset: Representation) -> None:
        """Raises InputError unless `asset` has the target's receivers and coefficients."""
        shape = (len(asset.elements), *asset.signal_shape)
        if shape != tuple(self.shape):
            raise InputError(
                f"the target's signal is {list(self.shape)}, the asset's {list(shape)}: give the "
                "transfer that the asset was compressed from"
            )

    def scaled(self, asset: Representation) -> torch.Tensor:
        """The asset's rows [V, D] in the target's scale."""
        return self._compared(scaled_rows(asset, self.metric))

    def _compared(self, scaled: torch.Tensor) -> torch.Tensor:
        return (self.reflectance * scaled).flatten(1)

    def __call__(self, asset: Representation) -> torch.Tensor:
        """A scalar, the square of the relative RMSE to expect; gradients reach the asset's signal."""
        return self.norm.squared(self.scaled(asset) - self.target) / self.energy
