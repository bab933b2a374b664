"""Clustered transfer in few bytes: how many components fit a budget, and the numbers that storage then holds."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

import torch

from diffprt.compression import ClusteredSignal, cluster_pca, rounded
from diffprt.compression.clusters.components import blend, least_squares, orthonormal
from diffprt.compression.encode import encoded_bytes
from diffprt.errors import InputError
from diffprt.optimization.lattice import fine_weights, tilt
from diffprt.optimization.transfer_loss import TransferLoss
from diffprt.representation import Metric, Representation

# Formats of weights and of bases, by rising size; later ones are tried when the earlier have components to spare.
_FORMATS = (("uint8", "uint8"), ("uint8", "float16"), ("float16", "float16"), ("float32", "float32"))
_MOST_COMPONENTS = 64


@singledispatch
def fit_to_bytes(asset: Representation, loss: TransferLoss | None, size: int) -> Representation:
    """The asset in `size` bytes; only compressed transfer can be fitted anew, all else is refused."""
    asset.refuse("cannot be fitted to bytes", "compress it first")


@fit_to_bytes.register
def _fit_clusters(asset: ClusteredSignal, loss: TransferLoss | None, size: int) -> ClusteredSignal:
    """As many components as `size` bytes hold, in the formats of least error, on the clusters that `asset` has.

    Args:
        asset: clustered transfer.
        loss: against the uncompressed transfer, to which components are fitted in closed form.
        size: bytes of means, bases, weights and labels.

    Returns:
        clustered transfer whose numbers are not rounded yet (`encoded` does that), in the formats that they are for.

    Raises:
        InputError: not even one component fits.
    """
    entries = asset.means[0].numel()
    most = min(entries, _MOST_COMPONENTS)
    candidates = []
    for weights_format, bases_format in _FORMATS:
        fits = [p for p in range(1, most + 1) if _bytes(asset, p, weights_format, bases_format) <= size]
        if fits:
            candidates.append((fits[-1], weights_format, bases_format))
        if not fits or (fits[-1] < most and bases_format == "float16"):
            break
    if not candidates:
        least = _bytes(asset, 1, *_FORMATS[0])
        raise InputError(
            f"bytes is {size}, one component of {asset.clusters} clusters takes {least}: give more, or compress with "
            "fewer clusters"
        )
    if loss is None:
        raise InputError("bytes needs the uncompressed transfer, to which components are fitted: give target")
    metric = loss.metric
    rows = metric.scale(loss.signal).flatten(1)
    components = max(found[0] for found in candidates)
    means, bases, weights = cluster_pca(rows, asset.labels, asset.clusters, components)
    made = [
        replace(
            asset,
            means=metric.unscale(means.view_as(asset.means)),
            bases=metric.unscale(bases[:, :count].reshape(asset.clusters, count, *asset.means.shape[1:])),
            weights=weights[:, :count].contiguous(),
            weights_format=weights_format,
            bases_format=bases_format,
        )
        for count, weights_format, bases_format in candidates
    ]
    return min(made, key=lambda one: float(loss(encoded(one, metric)))) if len(made) > 1 else made[0]


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
