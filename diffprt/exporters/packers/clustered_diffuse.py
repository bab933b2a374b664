"""Clustered diffuse transfer: the vertex blends the colors of its cluster, in one pass or in passes of few uniforms."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer, clusters_per_pass, super_clusters
from diffprt.exporters.packers.diffuse import unshadowed
from diffprt.exporters.packers.packed import Packed, floats, surface_arrays

# Light has three colors, whether or not transfer colors it.
_CHANNELS = 3


def pack_clustered_diffuse(asset: ClusteredTransfer) -> Packed:
    """Diffuse transfer by clusters."""
    sizes = cluster_sizes(asset)
    geometry = surface_arrays(asset.receivers, albedo=True)
    packed = Packed(
        kind="clustered_diffuse",
        page="clustered_diffuse",
        programs=("clustered_diffuse",),
        geometry=geometry,
        signal=cluster_arrays(asset),
        numbers={**sizes, "coefficients": asset.order**2},
        facts={"order": asset.order, **sizes},
        equation="transfer = means[label] + sum_p weights[p] bases[label, p], [C, K]; "
        "radiance = albedo / pi * sum_k transfer[c, k] light[k]",
        tables=("means", "bases"),
        unshadowed=unshadowed(asset.order, geometry),
    )
    return replace(packed, passes=partial(_by_passes, packed, asset))


def cluster_sizes(asset: ClusteredTransfer | ClusteredGlossyTransfer) -> dict[str, int]:
    """How many channels, clusters and components."""
    return {"channels": asset.channels, "clusters": asset.clusters, "components": asset.components}


def cluster_arrays(asset: ClusteredTransfer | ClusteredGlossyTransfer) -> dict[str, np.ndarray]:
    """Labels in the smallest type that holds them, means, bases and weights."""
    smallest = np.uint8 if asset.clusters <= 1 << 8 else np.uint16 if asset.clusters <= 1 << 16 else np.uint32
    return {
        "labels": asset.labels.detach().cpu().numpy().astype(smallest),
        "means": floats(asset.means),
        "bases": floats(asset.bases),
        "weights": floats(asset.weights),
    }


def _by_passes(packed: Packed, asset: ClusteredTransfer, registers: int) -> Packed:
    """Numbers clusters pass by pass, so that each pass names its own by a first one and a count.

    Args:
        packed: of `asset`, for one pass.
        asset: clustered diffuse transfer with faces.
        registers: float4 registers of a pass; see `clusters_per_pass`.

    Returns:
        The same arrays with clusters in another order, faces that lie on an earlier one left out (passes would add
        both), and `passes` [passes + 1]: the first cluster of each, then M.

    Raises:
        InputError: the registers hold no cluster, or there are no faces.
    """
    per_pass = clusters_per_pass(registers, asset.components, channels=_CHANNELS)
    grouped = super_clusters(asset.labels, asset.receivers.faces, per_pass)
    groups = np.full(asset.clusters, grouped.passes - 1)
    groups[: len(grouped.groups)] = grouped.groups.numpy()
    used = np.zeros(asset.clusters, dtype=bool)
    used[asset.labels.numpy()] = True
    # Clusters that no vertex has come after the last pass: nothing looks them up.
    order = np.argsort(np.where(used, groups, grouped.passes), kind="stable")
    counts = np.bincount(groups[used], minlength=grouped.passes)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    signal = packed.signal
    return replace(
        packed,
        programs=(*packed.programs, "clustered_diffuse_passes", "passes_display"),
        geometry={**packed.geometry, "indices": _without_repeats(packed.geometry)},
        signal={
            **signal,
            "labels": place[signal["labels"]].astype(signal["labels"].dtype),
            "means": signal["means"][order],
            "bases": signal["bases"][order],
            "passes": np.concatenate([[0], np.cumsum(counts)]).astype(np.uint32),
        },
        numbers={**packed.numbers, "registers": registers},
        facts={**packed.facts, "registers": registers, "passes": grouped.passes, "overdraw": grouped.overdraw},
    )


def _without_repeats(geometry: dict[str, np.ndarray]) -> np.ndarray:
    """Faces, less those with the same three positions as an earlier one, which hides them."""
    rows = np.ascontiguousarray(geometry["positions"] + np.float32(0))  # -0 is 0
    _, point = np.unique(rows.view(f"V{rows.itemsize * 3}")[:, 0], return_inverse=True)
    corners = np.sort(point.reshape(-1)[geometry["indices"]], axis=1)
    _, first = np.unique(corners, axis=0, return_index=True)
    return geometry["indices"][np.sort(first)]
