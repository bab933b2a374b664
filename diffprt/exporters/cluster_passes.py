"""Clusters in the order of the passes that draw them, for hardware that holds few uniforms."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from diffprt.compression import ClusteredTransfer, clusters_per_pass, super_clusters

if TYPE_CHECKING:
    from diffprt.exporters.packers import Packed

# Light has three colors, whether or not transfer colors it.
_CHANNELS = 3


def by_passes(packed: Packed, asset: ClusteredTransfer, registers: int) -> Packed:
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
