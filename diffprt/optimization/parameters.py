"""What is trained of an asset, in coordinates in which every entry moves pictures about as much.

Transfer is scaled by its `Metric`, components by the spread of their weights. Adam's steps are as long in flat
directions as in steep ones, so their length is set by what is left to gain: with learning rate 1, a step of each
parameter on its own changes pictures by about their error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from diffprt.compression import ClusteredSignal, GlossyAsset, rounded
from diffprt.errors import InputError
from diffprt.optimization.metric import Metric
from diffprt.options.optimize import CLUSTERED, PARAMETERS, SIGNALS
from diffprt.transfer import Transfer

_DARKEST = 1e-3
# An albedo of a half changes by a quarter of what its logit changes by, half of itself.
_LOGIT = 2.0
_LEAST_ERROR = 1e-6


class Parameters:
    """Leaves of an optimization and the asset that they stand for.

    Args:
        asset: where training starts.
        names: some of `PARAMETERS` that the asset has (`check_names`), but "labels", which are whole numbers.
        metric: of the signal.
        error: relative error of the asset's pictures.
        lights: coefficients [L, K, 3] of the distinct lights, for "light".

    Attributes:
        leaves: tensors that require gradients, by name.
        rates: what the learning rate is multiplied by for each of them.
    """

    def __init__(
        self, asset, names: Sequence[str], metric: Metric, *, error: float = 1.0, lights: torch.Tensor
    ) -> None:
        self.start = asset
        self.metric = metric
        self.leaves: dict[str, torch.Tensor] = {}
        self.rates: dict[str, float] = {}
        error = max(error, _LEAST_ERROR)
        for name in names:
            if name in ("diffuse", "glossy"):
                signal = metric.scale(getattr(asset, name))
                self._add(name, signal, error * _size(signal))
            elif name == "albedo":
                logit = asset.receivers.albedo.clamp(_DARKEST, 1 - _DARKEST).logit()
                self._add(name, logit, error * _LOGIT)
            elif name == "exposure":
                self._add(name, torch.zeros(()), error)
            elif name == "light":
                self._add(name, lights, error * _size(lights))
        if isinstance(asset, ClusteredSignal):
            self._add_clusters(names, error)

    def _add_clusters(self, names: Sequence[str], error: float) -> None:
        asset = self.start
        means, bases = self.metric.scale(asset.means), self.metric.scale(asset.bases)
        self._spread = _spread(asset.weights, asset.labels, asset.clusters)
        components = max(1, asset.components)
        rows = bases * _aligned(self._spread, bases)
        entries = means[0].numel()
        length = error * float(means.flatten(1)[asset.labels].square().sum(1).mean().sqrt())
        if "means" in names:
            self._add("means", means, length / entries**0.5)
        if "bases" in names:
            self._add("bases", rows, length / (entries * components) ** 0.5)
        if "weights" in names:
            spread = float(rows.flatten(1)[asset.labels].square().sum(1).mean().sqrt())
            self._add("weights", asset.weights / self._spread[asset.labels], length / spread if spread > 0 else 0.0)

    def _add(self, name: str, values: torch.Tensor, rate: float) -> None:
        self.leaves[name] = values.detach().clone().requires_grad_(True)
        self.rates[name] = rate

    def asset(self):
        """The asset as it is now, bases in the format that they are stored in; gradients reach the leaves."""
        asset, leaves = self.start, self.leaves
        found = {name: self.metric.unscale(leaves[name]) for name in ("diffuse", "glossy") if name in leaves}
        if isinstance(asset, ClusteredSignal):
            means, bases, weights = asset.means, asset.bases, asset.weights
            if "means" in leaves:
                means = self.metric.unscale(leaves["means"])
            if "bases" in leaves:
                bases = self.metric.unscale(leaves["bases"] / _aligned(self._spread, bases))
            if "weights" in leaves:
                weights = leaves["weights"] * self._spread[asset.labels]
            found |= stored(means, bases, weights, asset.weights_format, asset.bases_format)
        receivers = asset.receivers
        if "albedo" in leaves:
            receivers = replace(receivers, albedo=leaves["albedo"].sigmoid())
        return replace(asset, receivers=receivers, **found)

    @property
    def exposure(self) -> torch.Tensor | float:
        """Factor on the asset's radiance."""
        return self.leaves["exposure"].exp() if "exposure" in self.leaves else 1.0

    def state(self) -> dict[str, torch.Tensor]:
        """A copy of the leaves' values."""
        return {name: leaf.detach().clone() for name, leaf in self.leaves.items()}

    def restore(self, state: dict[str, torch.Tensor]) -> None:
        """Sets the leaves to what `state` returned."""
        with torch.no_grad():
            for name, leaf in self.leaves.items():
                leaf.copy_(state[name])


def check_names(asset, names: Sequence[str]) -> None:
    """Raises InputError unless `names` are of parameters that the asset has."""
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown or not names:
        raise InputError(f"parameters are {', '.join(names) or 'none'}: use some of {', '.join(PARAMETERS)}")
    missing = [name for name in names if name in (*SIGNALS, "labels") and not hasattr(asset, name)]
    if missing:
        has = [name for name in PARAMETERS if hasattr(asset, name)] + ["exposure", "light"]
        raise InputError(f"a {type(asset).__name__} has no {', '.join(missing)}: use some of {', '.join(has)}")
    if "albedo" in names and isinstance(asset, GlossyAsset):
        raise InputError("a glossy asset has its reflectance inside: leave albedo out of the parameters")


def stored(
    means: torch.Tensor, bases: torch.Tensor, weights: torch.Tensor, weights_format: str, bases_format: str
) -> dict[str, torch.Tensor]:
    """Means, bases and weights as they come back from storage, straight-through (`rounded`).

    Weights in eight bits are left as they are: rounding chooses two at a time, at the end (`formats.encoded`).
    """
    if bases_format != "float32":
        means = rounded(means.flatten(1)[:, None], bases_format)[:, 0].view_as(means)
        bases = rounded(bases, bases_format)
    if weights_format == "float16":
        weights = rounded(weights, weights_format)
    return {"means": means, "bases": bases, "weights": weights}


def trainable(asset) -> tuple[str, ...]:
    """The signal's parameters of an asset: what is trained without further notice."""
    if isinstance(asset, Transfer):
        return ("diffuse",)
    return CLUSTERED if isinstance(asset, ClusteredSignal) else ("glossy",)


def _spread(weights: torch.Tensor, labels: torch.Tensor, clusters: int) -> torch.Tensor:
    """Root mean square [M, P] of the weights of each component, above 0."""
    count = torch.bincount(labels, minlength=clusters).clamp_min(1)[:, None]
    square = torch.zeros(clusters, weights.shape[1], dtype=weights.dtype)
    square = square.index_add_(0, labels, weights.detach().square()) / count
    spread = square.sqrt()
    return spread.clamp_min(1e-3 * float(spread.max()) or 1.0)


def _aligned(spread: torch.Tensor, bases: torch.Tensor) -> torch.Tensor:
    """`spread` [M, P] with as many dimensions as `bases` [M, P, ...]."""
    return spread.view(*spread.shape, *(1,) * (bases.dim() - 2))


def _size(values: torch.Tensor) -> float:
    return float(values.detach().square().mean().sqrt())
