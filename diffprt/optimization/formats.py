"""Clustered transfer in few bytes: how many components fit a budget, and the numbers that storage then holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import singledispatch

import torch

from diffprt.compression import ClusteredSignal, cluster_pca, rounded
from diffprt.compression.budget import FORMAT_PAIRS, MOST_COMPONENTS, Budget, Form, choose
from diffprt.compression.clusters.components import blend, least_squares, orthonormal
from diffprt.compression.encode import encoded_bytes
from diffprt.errors import InputError
from diffprt.optimization.lattice import fine_weights, tilt
from diffprt.optimization.transfer_loss import TransferLoss
from diffprt.representation import Metric, Provenance, Representation
from diffprt.representation.file_size import shapes_of, unmeasured
from diffprt.representation.geometry import MEASURED, with_geometry


@singledispatch
def fit_to_bytes(
    asset: Representation,
    loss: TransferLoss | None,
    size: int,
    provenance: Callable[[Provenance], Provenance],
    geometry: int | None = None,
) -> Representation:
    """The asset in a file of `size` bytes; only compressed transfer can be fitted anew, all else is refused."""
    asset.refuse("cannot be fitted to bytes", "compress it first")


@fit_to_bytes.register
def _fit_file(
    asset: ClusteredSignal,
    loss: TransferLoss | None,
    size: int,
    provenance: Callable[[Provenance], Provenance],
    geometry: int | None = None,
) -> ClusteredSignal:
    """As many components as a file of `size` bytes holds, in the formats of least error, on the clusters of `asset`.

    Geometry is in 16 bits where that lowers the error, and openness is dropped where it would be over 3 % or nothing
    else fits.

    Args:
        asset: clustered transfer.
        loss: against the uncompressed transfer, to which components are fitted in closed form.
        size: bytes of the file.
        provenance: what the file will say of how it was made, at its widest, from that of `asset`.
        geometry: 32 or 16 where that is asked for.

    Returns:
        clustered transfer whose numbers are not rounded yet (`encoded` does that), in the formats that they are for.

    Raises:
        InputError: not even one component fits; the least is named.
    """
    loss = _needed(loss)
    written = {
        32: provenance(asset.provenance),
        16: provenance(asset.provenance.also(certificate=unmeasured(*MEASURED))),
    }
    budget = Budget(
        size=size,
        kind=type(asset),
        provenance=lambda form: written[form.geometry],
        receivers=asset.receivers,
        signal_shape=asset.signal_shape,
        beside=shapes_of(asset.beside_signal),
        geometry=geometry,
        dtype=asset.means.dtype,
    )
    least, _ = budget.smallest(asset.clusters, min(1, budget.most))
    if least > size:
        budget.refuse(
            least, f"one component of {asset.clusters} clusters", f"compress to fewer than {asset.clusters} clusters"
        )
    forms = {level: budget.forms(asset.clusters, level) for level in budget.levels}
    fitted = _fitted(asset, loss, max(form.components for found in forms.values() for form in found))

    def best(level: tuple[int, bool]) -> tuple[float, ClusteredSignal] | None:
        made = [fitted(form) for form in forms[level]]
        return min(((_error(one, loss), one) for one in made), key=lambda found: found[0]) if made else None

    return choose(budget.levels, best)


def fit_to_signal_bytes(asset: ClusteredSignal, loss: TransferLoss, size: int) -> ClusteredSignal:
    """As `fit_to_bytes`, of `size` bytes for means, bases, weights and labels alone, whatever stands beside them.

    Raises:
        InputError: not even one component fits.
    """
    most, forms = min(asset.means[0].numel(), MOST_COMPONENTS), []
    for formats in FORMAT_PAIRS:
        fits = [p for p in range(1, most + 1) if _bytes(asset, p, *formats) <= size]
        if fits:
            forms.append(Form(asset.clusters, fits[-1], *formats))
        if not fits or (fits[-1] < most and formats[1] == "float16"):
            break
    if not forms:
        least = _bytes(asset, 1, *FORMAT_PAIRS[0])
        raise InputError(f"one component of {asset.clusters} clusters takes {least} bytes, not {size}: give more")
    fitted = _fitted(asset, loss, max(form.components for form in forms))
    return min((fitted(form) for form in forms), key=lambda one: _error(one, loss))


def _fitted(asset: ClusteredSignal, loss: TransferLoss, components: int) -> Callable[[Form], ClusteredSignal]:
    """What makes forms of at most so many components, fitted to the loss's target on the clusters of `asset`."""
    metric = loss.metric
    rows = metric.scale(loss.signal).flatten(1)
    means, bases, weights = cluster_pca(rows, asset.labels, asset.clusters, components)
    shape = asset.means.shape[1:]

    def made(form: Form) -> ClusteredSignal:
        count = form.components
        found = asset if form.beside else replace(asset, **dict.fromkeys(asset.beside_signal))
        found = replace(
            found,
            means=metric.unscale(means.view_as(asset.means)),
            bases=metric.unscale(bases[:, :count].reshape(asset.clusters, count, *shape)),
            weights=weights[:, :count].contiguous(),
            weights_format=form.weights_format,
            bases_format=form.bases_format,
        )
        return with_geometry(found, form.geometry)

    return made


def _error(asset: ClusteredSignal, loss: TransferLoss) -> float:
    """Relative RMSE to expect of pictures of what storage keeps; infinite where a number is beyond its format."""
    try:
        return float(loss(encoded(asset, loss.metric))) ** 0.5
    except InputError:
        return math.inf


def _needed(loss: TransferLoss | None) -> TransferLoss:
    if loss is None:
        raise InputError("bytes needs the uncompressed transfer, to which components are fitted: give target")
    return loss


@singledispatch
def encoded(asset: Representation, metric: Metric) -> Representation:
    """The asset as it comes back from storage: unchanged, unless its numbers are stored in few bits."""
    return asset


@encoded.register
def _encoded_clusters(asset: ClusteredSignal, metric: Metric) -> ClusteredSignal:
    """The asset as it comes back from storage in its formats.

    Without rounding, bases get orthonormal rows. Else means and bases are rounded first, and weights then chosen for
    what is left of them; those in eight bits with levels that components lend each other (`lattice`).
    """
    labels, shape = asset.labels, asset.means.shape[1:]
    if asset.weights_format == asset.bases_format == "float32":
        bases, weights = orthonormal(asset.bases.flatten(2), asset.weights, labels)
        return replace(asset, bases=bases.view_as(asset.bases), weights=weights)
    means, bases = metric.scale(asset.means).flatten(1), metric.scale(asset.bases).flatten(2)
    rows = blend(labels, asset.weights, means, bases)
    bases, weights = orthonormal(bases, asset.weights, labels)
    tilted, pairs = tilt(bases, weights, labels)
    if asset.weights_format != "uint8":
        tilted, pairs = bases, replace(pairs, neighbors=torch.ones_like(pairs.neighbors))
    plain = metric.unscale(tilted.unflatten(2, shape))
    means = rounded(asset.means.flatten(1)[:, None], asset.bases_format)[:, 0].view_as(asset.means)
    plain = rounded(plain, asset.bases_format)
    near, tilted = metric.scale(means).flatten(1), metric.scale(plain).flatten(2)
    if asset.weights_format == "uint8":
        weights = fine_weights(rows, near, tilted, labels, pairs)
    else:
        weights = rounded(least_squares(rows, near, tilted, labels), asset.weights_format)
    return replace(asset, means=means, bases=plain, weights=weights)


def _bytes(asset, components: int, weights_format: str, bases_format: str) -> int:
    bases = asset.means[:, None].expand(-1, components, *asset.means.shape[1:])
    weights = asset.means.new_empty(1).expand(len(asset.labels), components)
    return encoded_bytes(asset.labels, asset.means, bases, weights, weights_format, bases_format)
