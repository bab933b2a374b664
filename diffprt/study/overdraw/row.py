"""One row of the overdraw study: a signal, clustered in one way, and all that is measured of it."""

from __future__ import annotations

import torch

from diffprt.compression import overdraw, squared_errors, super_clusters
from diffprt.compression.encode import Encoded
from diffprt.compression.overdraw.super_clusters import SELECTIONS
from diffprt.errors import InputError
from diffprt.study.overdraw.image import HeldOut
from diffprt.study.overdraw.methods import Method, cluster_energy
from diffprt.study.overdraw.signal import Signal


def overdraw_row(
    signal: Signal, held_out: HeldOut, method: Method, *, clusters: int, components: int, budgets: tuple[int, ...]
) -> tuple[dict, dict[str, torch.Tensor]]:
    """Clusters and measures.

    Returns:
        Plain numbers, and maps: labels int32 [V] and squared errors float32 [V]. `squared_error` is the mean over
        receivers of the squared distance, as in the thesis; `energy` the same to the means alone; `overdraw` its
        equation 8; `super_clusters` that and the passes for every budget of registers and selection, None where not
        one cluster fits; `image_errors` for each light, and `image_error` their mean; `cpu_seconds` of everything
        from the signal to the weights.
    """
    found, seconds = method.cluster(signal, clusters, components)
    faces = signal.receivers.faces
    images = held_out.errors(found.decode)
    squared = squared_errors(signal.vectors, found)
    row = {
        "scene": signal.scene,
        "brdf": signal.settings.brdf,
        "channels": signal.channels,
        "receivers": len(signal.receivers),
        "size": signal.vectors.shape[1],
        "method": str(method),
        "seed": method.seed,
        "clusters": clusters,
        "clusters_found": len(found.means),
        "components": components,
        "cpu_seconds": seconds,
        "iterations": found.counts["iterations"],
        "coherence": found.counts.get("coherence"),
        "energy": cluster_energy(signal.vectors, found.labels),
        "squared_error": float(squared.mean()),
        "signal_energy": float(signal.vectors.square().sum(1).double().mean()),
        "bytes": found.nbytes,
        "overdraw": overdraw(found.labels, faces),
        "super_clusters": {str(b): _grouped(signal, found, components, b) for b in budgets},
        "image_errors": images,
        "image_error": sum(images.values()) / len(images) if images else None,
    }
    return row, {"labels": found.labels.int(), "squared_error": squared.float()}


def _grouped(signal: Signal, found: Encoded, components: int, budget: int) -> dict | None:
    try:
        per_pass = signal.per_pass(budget, components)
    except InputError:
        return None
    result: dict = {"clusters_per_pass": per_pass}
    for selection in SELECTIONS:
        grouped = super_clusters(found.labels, signal.receivers.faces, per_pass, selection=selection)
        result[selection] = {"overdraw": grouped.overdraw, "passes": grouped.passes}
    return result
