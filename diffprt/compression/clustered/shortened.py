"""Clustered transfer with fewer of its components: the first of each cluster, by falling spread of its members."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.compression.clusters.components import orthonormal


def by_spread(asset: ClusteredSignal) -> ClusteredSignal:
    """The same signal, with components along the principal axes of each cluster's members, the widest first."""
    bases, weights = orthonormal(asset.bases.detach().flatten(2), asset.weights.detach(), asset.labels)
    return replace(asset, bases=bases.view_as(asset.bases), weights=weights)


def shortened(asset: ClusteredSignal, components: int) -> ClusteredSignal:
    """The first components of what `by_spread` made; of all with so few on these labels, with the least error.

    The certificate loses what it says of the signal's error, which no longer holds.
    """
    kept = {
        key: value
        for key, value in asset.certificate.items()
        if not key.startswith(("compression", "optimized", "shortened"))
    }
    return replace(
        asset,
        bases=asset.bases[:, :components].contiguous(),
        weights=asset.weights[:, :components].contiguous(),
        provenance=replace(asset.provenance, certificate=kept),
    )


def squared_distances(asset: ClusteredSignal, signal: torch.Tensor, *, rows: int = 4096) -> torch.Tensor:
    """Squared error float64 [V] of the asset's signal beside another one, [V, ...]."""
    parts = []
    for own in torch.arange(len(signal)).split(rows):
        decoded = asset.picked(own).decode().signal.flatten(1)
        parts.append((decoded.detach().double() - signal[own].detach().double().flatten(1)).square().sum(1))
    return torch.cat(parts)
