"""Compression of transfer by clustered principal component analysis."""

from __future__ import annotations

import time

import torch

from diffprt.compress.clustered import ClusteredTransfer
from diffprt.compress.lbg import lbg
from diffprt.compress.pca import cluster_pca
from diffprt.errors import InputError
from diffprt.transfer import Transfer

METHODS = ("lbg",)


def compress(
    transfer: Transfer,
    *,
    clusters: int = 64,
    components: int = 8,
    method: str = "lbg",
    seed: int = 0,
    iterations: int = 50,
    report: dict | None = None,
) -> ClusteredTransfer:
    """Clusters receivers by their signal and keeps a few principal components per cluster (CPCA).

    One label and one set of weights per receiver serve all channels and coefficients.

    Args:
        transfer: what `bake` returns.
        clusters: M, at most; clusters beyond the number of distinct signals are dropped and reported.
        components: P per cluster.
        method: "lbg": clusters around means first, components afterwards (thesis 2005, section 3.1).
        seed: of the start.
        iterations: at most this many rounds of clustering.
        report: filled with timings, counts and errors.

    Returns:
        `ClusteredTransfer`; `decode()` is differentiable, the clustering itself is not.

    Raises:
        InputError: an option is out of range.
    """
    if not 1 <= clusters <= 65536:
        raise InputError(f"clusters is {clusters}: give 1 to 65536, such as 64")
    size = transfer.diffuse[0].numel()
    if not 0 <= components <= min(size, 64):
        raise InputError(f"components is {components}: give 0 to {min(size, 64)}, such as 8")
    if method not in METHODS:
        raise InputError(f"method '{method}' is unknown: use one of {', '.join(METHODS)}")
    if iterations < 1:
        raise InputError(f"iterations is {iterations}: give 1 or more, such as 50")
    vectors = transfer.diffuse.detach().reshape(len(transfer.receivers), -1)
    begun = time.perf_counter()
    partition = lbg(vectors, clusters, seed=seed, iterations=iterations)
    clustered = time.perf_counter()
    found = len(partition.centers)
    means, bases, weights = cluster_pca(vectors, partition.labels, found, components)
    finished = time.perf_counter()
    shape = transfer.diffuse.shape[1:]
    compressed = ClusteredTransfer(
        labels=partition.labels,
        means=means.reshape(found, *shape),
        bases=bases.reshape(found, components, *shape),
        weights=weights,
        receivers=transfer.receivers,
        settings={
            **transfer.settings,
            "compress": {"clusters": clusters, "components": components, "method": method, "seed": seed},
        },
        plan=transfer.plan,
        certificate={
            **transfer.certificate,
            **compression_error(transfer.diffuse, means, bases, weights, partition.labels),
        },
        scene_hash=transfer.scene_hash,
    )
    if report is not None:
        report["timings"] = {
            "clustering": clustered - begun,
            "components": finished - clustered,
            "total": finished - begun,
        }
        report["counts"] = {
            "clusters": found,
            "clusters_dropped": clusters - found,
            "components": components,
            "iterations": partition.iterations,
            "bytes": compressed.nbytes,
            "bytes_before": transfer.nbytes,
        }
        report["errors"] = {k: v for k, v in compressed.certificate.items() if k.startswith("compression")}
    return compressed


def compression_error(
    signal: torch.Tensor,
    means: torch.Tensor,
    bases: torch.Tensor,
    weights: torch.Tensor,
    labels: torch.Tensor,
) -> dict:
    """How far the compressed form [over D = C K] is from `signal` [V, C, K].

    Returns:
        `compression_squared_error` (mean over receivers of the squared distance, as in the thesis's tables),
        `compression_relative` (root of its share of the signal's energy) and `compression_worst` (largest
        distance of a receiver over the signal's root mean square).
    """
    truth = signal.detach().reshape(len(signal), -1).double()
    squared = torch.empty(len(truth), dtype=torch.float64)
    for rows in torch.arange(len(truth)).split(4096):
        own = labels[rows]
        decoded = means[own].double() + torch.einsum("vp,vpd->vd", weights[rows].double(), bases[own].double())
        squared[rows] = (truth[rows] - decoded).square().sum(1)
    energy = float(truth.square().sum(1).mean())
    scale = energy**0.5 or 1.0
    return {
        "compression_squared_error": float(squared.mean()),
        "compression_relative": float(squared.mean()) ** 0.5 / scale,
        "compression_worst": float(squared.max()) ** 0.5 / scale,
    }
