"""Compression of transfer by clustered principal component analysis."""

from __future__ import annotations

import time

import torch

from diffprt.compression.clustered.diffuse import ClusteredTransfer
from diffprt.compression.clustered.glossy import ClusteredGlossyTransfer
from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.compression.encode import encode, squared_errors
from diffprt.compression.overdraw.overdraw import overdraw
from diffprt.compression.overdraw.super_clusters import clusters_per_pass, super_clusters
from diffprt.compression.prior import check_prior
from diffprt.errors import InputError
from diffprt.transfer import GlossyTransfer, Transfer

_ROWS = 4096


def compress(
    transfer: Transfer | GlossyTransfer,
    *,
    clusters: int = 64,
    components: int = 8,
    method: str | None = None,
    coherence: float | None = None,
    slack: float = 0.1,
    registers: int | None = None,
    prior: torch.Tensor | None = None,
    weights_format: str = "float32",
    bases_format: str = "float32",
    start: str = "k-means++",
    seed: int = 0,
    iterations: int = 50,
    report: dict | None = None,
) -> ClusteredTransfer | ClusteredGlossyTransfer:
    """Clusters receivers by their signal and keeps a few principal components per cluster (CPCA).

    One label and one set of weights per receiver serve all channels and coefficients.

    Args:
        transfer: what `bake` or `bake_glossy` returns.
        clusters: M, at most; clusters beyond the number of distinct signals are dropped and reported.
        components: P per cluster.
        method: one of `METHODS`; without, the best one: "k-subspaces-overdraw" on meshes, "k-subspaces" on points.
        coherence: how much overdraw counts, in the method's own unit (see `cluster`); chosen when not given.
        slack: how far above the least error the choice may go, as a share.
        registers: float4 registers of a display that draws in passes; super-clusters that fit are then formed while
            clustering, and the triangles between them are what is spared first.
        prior: float [K], mean square of each coefficient of incident light (`light_prior`): errors are then weighed
            as such lights show them, and the unweighted error is a little higher.
        weights_format, bases_format: "float32", "float16" or "uint8", per cluster and component.
        start: "k-means++" or the thesis's "hyper-box".
        seed: of the start.
        iterations: at most this many rounds of clustering, and of subspaces after it.
        report: filled with timings, counts and errors.

    Returns:
        `ClusteredTransfer` of diffuse, `ClusteredGlossyTransfer` of glossy transfer; `decode()` is differentiable, the
        clustering itself is not. The certificate's errors are unweighted whatever the prior.

    Raises:
        InputError: an option is out of range, or the transfer is compressed already.
    """
    begun = time.perf_counter()
    signal = _signal(transfer).detach()
    vectors = signal.reshape(len(signal), -1)
    faces, shape = transfer.receivers.faces, signal.shape[1:]
    weights = None
    if prior is not None:
        prior = check_prior(prior, shape[-1])
        weights = prior.expand(shape).reshape(-1)
    per_pass = None
    if registers is not None:
        outputs = shape[1] if isinstance(transfer, GlossyTransfer) else 1
        per_pass = clusters_per_pass(registers, components, channels=transfer.channels, outputs=outputs)
    encoded = encode(
        vectors,
        clusters=clusters,
        components=components,
        method=method,
        positions=transfer.receivers.positions,
        faces=faces,
        coherence=coherence,
        slack=slack,
        per_pass=per_pass,
        prior=weights,
        weights_format=weights_format,
        bases_format=bases_format,
        start=start,
        seed=seed,
        iterations=iterations,
    )
    found = len(encoded.means)
    squared = squared_errors(vectors, encoded)
    options = {
        "clusters": clusters,
        "components": components,
        "method": encoded.method,
        "seed": seed,
        "start": start,
        "weights_format": weights_format,
        "bases_format": bases_format,
        "coherence": encoded.counts.get("coherence"),
        "registers": registers,
        "prior": None if prior is None else prior.tolist(),
    }
    kept = {
        "labels": encoded.labels,
        "means": encoded.means.reshape(found, *shape),
        "bases": encoded.bases.reshape(found, components, *shape),
        "weights": encoded.weights,
        "receivers": transfer.receivers,
        "settings": {**transfer.settings, "compress": options},
        "plan": transfer.plan,
        "certificate": {**transfer.certificate, **compression_error(vectors, squared)},
        "scene_hash": transfer.scene_hash,
        "weights_format": weights_format,
        "bases_format": bases_format,
    }
    if isinstance(transfer, GlossyTransfer):
        compressed = ClusteredGlossyTransfer(**kept)
    else:
        compressed = ClusteredTransfer(**kept, openness=transfer.openness, bent_normals=transfer.bent_normals)
    if report is not None:
        report["timings"] = {**encoded.timings, "total": time.perf_counter() - begun}
        report["counts"] = {
            "clusters": found,
            "components": components,
            **encoded.counts,
            "bytes": compressed.nbytes,
            "bytes_before": transfer.nbytes,
        }
        if len(faces):
            report["counts"]["overdraw"] = overdraw(encoded.labels, faces)
        if len(faces) and per_pass is not None:
            grouped = super_clusters(encoded.labels, faces, per_pass)
            report["counts"] |= {"passes": grouped.passes, "overdraw_super_clusters": grouped.overdraw}
        report["errors"] = {k: v for k, v in compressed.certificate.items() if k.startswith("compression")}
        if weights is not None:
            weighted = float(squared_errors(vectors, encoded, weights).mean())
            report["errors"]["compression_squared_error_weighted"] = weighted
    return compressed


def _signal(transfer: Transfer | GlossyTransfer) -> torch.Tensor:
    """What is to be compressed, [V, ...]."""
    if isinstance(transfer, ClusteredSignal):
        raise InputError(
            f"transfer is already compressed, to {transfer.clusters} clusters x {transfer.components} components: "
            "give the one that was baked, or its decode()"
        )
    if not isinstance(transfer, Transfer | GlossyTransfer):
        raise InputError(f"a {type(transfer).__name__} cannot be compressed: give a Transfer or GlossyTransfer")
    return transfer.glossy if isinstance(transfer, GlossyTransfer) else transfer.diffuse


def compression_error(vectors: torch.Tensor, squared: torch.Tensor) -> dict:
    """What squared errors [V] mean beside the signal `vectors` [V, D].

    Returns:
        `compression_squared_error` (mean over receivers of the squared distance, as in the thesis's tables),
        `compression_relative` (root of its share of the signal's energy) and `compression_worst` (largest
        distance of a receiver over the signal's root mean square).
    """
    rows = vectors.detach().split(_ROWS)  # no second copy of a signal that may fill the memory
    energy = float(torch.cat([part.square().sum(1, dtype=torch.float64) for part in rows]).mean())
    scale = energy**0.5 or 1.0
    return {
        "compression_squared_error": float(squared.mean()),
        "compression_relative": float(squared.mean()) ** 0.5 / scale,
        "compression_worst": float(squared.max()) ** 0.5 / scale,
    }
