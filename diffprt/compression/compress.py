"""Compression of transfer by clustered principal component analysis."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

import torch

from diffprt.compression.advice import advice
from diffprt.compression.budget import Budget, Form
from diffprt.compression.clustered import diffuse, glossy  # noqa: F401  their types register themselves
from diffprt.compression.clustered.signal import CLUSTERED, ClusteredSignal
from diffprt.compression.encode import encode, squared_errors
from diffprt.compression.overdraw.overdraw import overdraw
from diffprt.compression.overdraw.super_clusters import clusters_per_pass, super_clusters
from diffprt.compression.prior import check_prior
from diffprt.compression.to_bytes import encode_to_bytes
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions, CompressOptions
from diffprt.options.keywords import takes
from diffprt.representation.file_size import WIDEST, shapes_of, unmeasured
from diffprt.representation.geometry import MEASURED, with_geometry
from diffprt.transfer.at_receivers import TransferAtReceivers

# Entries of the certificate, in the order in which `compression_error` gives them.
ERRORS = ("compression_squared_error", "compression_relative", "compression_worst")
_ROWS = 4096


@takes(CompressOptions)
def compress(transfer: TransferAtReceivers, options: CompressOptions) -> ClusteredSignal:
    """Clusters receivers by their signal and keeps a few principal components per cluster (CPCA).

    One label and one set of weights per receiver serve all channels and coefficients.

    Args:
        transfer: what `bake` returns.
        options: see `CompressOptions`. Clusters beyond the number of distinct signals are dropped and reported. With
            registers, super-clusters that fit them are formed while clustering, and triangles between them are what is
            spared first. With a prior float [K], errors are weighed as such lights show them, and the unweighted error
            is a little higher.

    Returns:
        `ClusteredTransfer` of diffuse, `ClusteredGlossyTransfer` of glossy transfer; `decode()` is differentiable, the
        clustering itself is not. The certificate's errors are unweighted whatever the prior.

    Raises:
        InputError: an option is out of range, or the transfer is compressed already.
    """
    begun = time.perf_counter()
    kind, signal = clustered_kind(transfer), transfer.signal.detach()
    vectors = signal.reshape(len(signal), -1)
    faces, shape, components = transfer.receivers.faces, signal.shape[1:], options.components
    prior = weights = per_pass = None
    if not all(bool(torch.isfinite(part).all()) for part in vectors.detach().split(_ROWS)):
        raise InputError("transfer has signals that are not finite: bake it again, or repair them first")
    if options.prior is not None:
        prior = check_prior(options.prior, shape[-1])
        weights = prior.expand(shape).reshape(-1)
    if options.registers is not None:
        outputs = math.prod(shape[1:-1])
        per_pass = clusters_per_pass(options.registers, components, channels=transfer.channels, outputs=outputs)
    known: dict[str, Any] = {
        "positions": transfer.receivers.positions,
        "faces": faces,
        "per_pass": per_pass,
        "prior": weights,
    }
    known |= {"bytes": None, "geometry": None}
    clustering = ClusterOptions(**(vars(options) | known))
    settings = partial(_settings, options, clustering.chosen, prior)
    budget = Budget(
        size=options.bytes or 0,
        kind=kind,
        provenance=lambda form: transfer.provenance.also(
            settings={"compress": settings(form, WIDEST, WIDEST)},
            certificate=unmeasured(*ERRORS, *(MEASURED if form.geometry == 16 else ())),
        ),
        receivers=transfer.receivers,
        signal_shape=tuple(shape),
        beside=shapes_of(transfer.beside_signal),
        geometry=options.geometry,
        dtype=vectors.dtype,
    )
    if options.bytes is None:
        encoded = encode(vectors, **vars(clustering))
        bits = options.geometry or transfer.receivers.bits
        form = Form(len(encoded.means), components, options.weights_format, options.bases_format, bits)
    else:
        encoded, form = encode_to_bytes(vectors, clustering, budget)
        components = form.components
    found = len(encoded.means)
    squared = squared_errors(vectors, encoded)
    kept_options = settings(form, encoded.counts.get("coherence"), options.bytes)
    kept: dict[str, Any] = {
        "labels": encoded.labels,
        "means": encoded.means.reshape(found, *shape),
        "bases": encoded.bases.reshape(found, components, *shape),
        "weights": encoded.weights,
        "receivers": transfer.receivers,
        "provenance": transfer.provenance.also(
            settings={"compress": kept_options}, certificate=compression_error(vectors, squared)
        ),
        "weights_format": form.weights_format,
        "bases_format": form.bases_format,
    }
    kept.update(transfer.beside_signal if form.beside else {})
    compressed = with_geometry(kind(**kept), form.geometry)
    if (report := options.report) is not None:
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
        dropped = [] if form.beside else sorted(transfer.beside_signal)
        report["form"] = {**vars(form), "clusters": found, "dropped": dropped}
        del report["form"]["beside"]
        report |= advice(vectors, encoded, clustering, budget, form)
    return compressed


def _settings(
    options: CompressOptions,
    method: str,
    prior: torch.Tensor | None,
    form: Form,
    coherence: float | None,
    size: float | None,
) -> dict:
    """What the file says of how it was compressed; of its bytes and geometry where they are not as they always were."""
    found = {
        "clusters": options.clusters,
        "components": form.components,
        "method": method,
        "seed": options.seed,
        "start": options.start,
        "weights_format": form.weights_format,
        "bases_format": form.bases_format,
        "coherence": coherence,
        "registers": options.registers,
        "prior": None if prior is None else prior.tolist(),
    }
    if options.bytes is not None:
        found["bytes"] = size
    return found if form.geometry == 32 else found | {"geometry": form.geometry}


def clustered_kind(transfer: TransferAtReceivers) -> type[ClusteredSignal]:
    """The type that clusters of this transfer have; raises InputError where there is none."""
    kind = CLUSTERED.get(type(transfer))
    if kind is None:
        getattr(transfer, "signal", None)  # compressed transfer says what it is
        raise InputError(f"a {type(transfer).__name__} cannot be compressed: give what bake or bake_glossy made")
    return kind


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
    mean, worst = float(squared.mean()), float(squared.max())
    return dict(zip(ERRORS, (mean, mean**0.5 / scale, worst**0.5 / scale), strict=True))
