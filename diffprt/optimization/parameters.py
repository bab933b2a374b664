"""What is trained of an asset, in coordinates in which every entry moves pictures about as much.

Transfer is scaled by its `Metric`, components by the spread of their weights. Adam's steps are as long in flat
directions as in steep ones, so their length is set by what is left to gain: with learning rate 1, a step of each
parameter on its own changes pictures by about their error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import singledispatch

import torch

from diffprt.compression import ClusteredSignal, rounded
from diffprt.errors import InputError
from diffprt.options.optimize import PARAMETERS
from diffprt.representation import Metric, Representation

_SHARED = ("albedo", "exposure", "light")
_DARKEST = 1e-3
# An albedo of a half changes by a quarter of what its logit changes by, half of itself.
_LOGIT = 2.0
_LEAST_ERROR = 1e-6


class Coordinates:
    """The trainable tensors of an asset as leaves: each on its own, in the metric.

    Args:
        asset: where training starts.
        metric: of the signal.
    """

    def __init__(self, asset: Representation, metric: Metric) -> None:
        self.start, self.metric = asset, metric

    def leaves(self, names: Sequence[str]) -> dict[str, tuple[torch.Tensor, float]]:
        """Values of each, and the length of a step that changes pictures by about themselves."""
        scaled = {name: self.metric.scale(getattr(self.start, name)) for name in names if name in self.start.trainable}
        return {name: (values, _size(values)) for name, values in scaled.items()}

    def tensors(self, leaves: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """The asset's tensors that leaves stand for, as they come back from storage; gradients reach the leaves."""
        return {name: self.metric.unscale(leaves[name]) for name in self.start.trainable if name in leaves}


class ClusterCoordinates(Coordinates):
    """Means and bases in the metric, components scaled by the spread of their weights."""

    start: ClusteredSignal

    def __init__(self, asset: ClusteredSignal, metric: Metric) -> None:
        super().__init__(asset, metric)
        self._spread = _spread(asset.weights, asset.labels, asset.clusters)

    def leaves(self, names: Sequence[str]) -> dict[str, tuple[torch.Tensor, float]]:
        asset, found = self.start, {}
        means, bases = self.metric.scale(asset.means), self.metric.scale(asset.bases)
        components = max(1, asset.components)
        rows = bases * _aligned(self._spread, bases)
        entries = means[0].numel()
        length = float(means.flatten(1)[asset.labels].square().sum(1).mean().sqrt())
        if "means" in names:
            found["means"] = means, length / entries**0.5
        if "bases" in names:
            found["bases"] = rows, length / (entries * components) ** 0.5
        if "weights" in names:
            spread = float(rows.flatten(1)[asset.labels].square().sum(1).mean().sqrt())
            found["weights"] = asset.weights / self._spread[asset.labels], length / spread if spread > 0 else 0.0
        return found

    def tensors(self, leaves: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        means, bases, weights = self.start.means, self.start.bases, self.start.weights
        if "means" in leaves:
            means = self.metric.unscale(leaves["means"])
        if "bases" in leaves:
            bases = self.metric.unscale(leaves["bases"] / _aligned(self._spread, bases))
        if "weights" in leaves:
            weights = leaves["weights"] * self._spread[self.start.labels]
        return stored(means, bases, weights, self.start.weights_format, self.start.bases_format)


@singledispatch
def coordinates(asset: Representation, metric: Metric) -> Coordinates:
    """How an asset is trained; a kind whose tensors belong together registers its own."""
    return Coordinates(asset, metric)


@coordinates.register
def _(asset: ClusteredSignal, metric: Metric) -> Coordinates:
    return ClusterCoordinates(asset, metric)


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
        self, asset: Representation, names: Sequence[str], metric: Metric, *, error: float = 1.0, lights: torch.Tensor
    ) -> None:
        self.start = asset
        self.leaves: dict[str, torch.Tensor] = {}
        self.rates: dict[str, float] = {}
        self._coordinates = coordinates(asset, metric)
        error = max(error, _LEAST_ERROR)
        own = self._coordinates.leaves(names)
        for name in [name for name in names if name in _SHARED] + [name for name in own]:
            if name == "albedo":
                values, rate = asset.elements.albedo.clamp(_DARKEST, 1 - _DARKEST).logit(), _LOGIT  # pyright: ignore[reportAttributeAccessIssue]
            elif name == "exposure":
                values, rate = torch.zeros(()), 1.0
            elif name == "light":
                values, rate = lights, _size(lights)
            else:
                values, rate = own[name]
            self.leaves[name] = values.detach().clone().requires_grad_(True)
            self.rates[name] = error * rate

    def asset(self) -> Representation:
        """The asset as it is now, bases in the format that they are stored in; gradients reach the leaves."""
        found = replace(self.start, **self._coordinates.tensors(self.leaves))
        if "albedo" not in self.leaves:
            return found
        return found.with_elements(replace(found.elements, albedo=self.leaves["albedo"].sigmoid()))

    @property
    def exposure(self) -> torch.Tensor | float:
        """Factor on the asset's radiance."""
        return self.leaves["exposure"].exp() if "exposure" in self.leaves else 1.0

    def restore(self, state: dict[str, torch.Tensor]) -> None:
        """Sets the leaves to the values of `state`."""
        with torch.no_grad():
            for name, leaf in self.leaves.items():
                leaf.copy_(state[name])


def check_names(asset: Representation, names: Sequence[str]) -> None:
    """Raises InputError unless `names` are of parameters that the asset has."""
    has = (*asset.trainable, *(name for name in ("labels",) if name in asset.spec), *_SHARED)
    unknown = [name for name in names if name not in (*PARAMETERS, *has)]
    if unknown or not names:
        raise InputError(f"parameters are {', '.join(names) or 'none'}: use some of {', '.join(PARAMETERS)}")
    missing = [name for name in names if name not in has]
    if missing:
        asset.refuse(f"has no {', '.join(missing)}", f"use some of {', '.join(has)}")
    if "albedo" in names:
        asset.check_albedo()


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
