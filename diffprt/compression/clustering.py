"""Partitions of receivers by their signals, by any of the methods."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import import_module

import torch

from diffprt.compression.clusters.partition import Clustering, canonical
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.options.compress import METHODS, ClusterOptions
from diffprt.options.keywords import takes

_REMAINDER = 1e-3


@takes(ClusterOptions)
def cluster(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """Partitions receivers by their signals float [V, D]; see `METHODS`, `ClusterOptions` and `CompressOptions`.

    Raises:
        InputError: the method needs faces or positions that are not there, or an option is out of range.
    """
    file, function = METHODS[options.chosen].function.split(":")
    method = getattr(import_module(f"diffprt.compression.methods.{file}"), function)
    begun = time.perf_counter()
    span = principal_span(vectors, remainder=_REMAINDER, seed=options.seed)
    spanned = time.perf_counter()
    found = method(span.coordinates, options)
    timings = {"span": spanned - begun, "clustering": time.perf_counter() - spanned}
    return replace(found, labels=canonical(found.labels)[0], timings=timings)
