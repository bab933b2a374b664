"""Compression into a file of at most so many bytes: as many components as fit, in the formats of least error."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import torch

from diffprt.compression.budget import Budget, Form, choose, ladder, most_clusters
from diffprt.compression.clustering import cluster
from diffprt.compression.clusters.components import cluster_pca
from diffprt.compression.encode import Encoded, squared_errors, stored_form
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions
from diffprt.torch_threads import one_torch_thread

# Clusters are found around at most so many components: with more, hardly anything is left that tells them apart.
_MOST_CLUSTERED = 12


@dataclass(frozen=True)
class _Start:
    """Clusters with more components than any form has."""

    asked: int
    labels: torch.Tensor
    fitted: tuple[torch.Tensor, torch.Tensor, torch.Tensor]
    counts: dict
    timings: dict

    @property
    def clusters(self) -> int:
        return len(self.fitted[0])


@one_torch_thread()
def encode_to_bytes(vectors: torch.Tensor, options: ClusterOptions, budget: Budget) -> tuple[Encoded, Form]:
    """Clusters of any signal whose file has at most `budget.size` bytes; the same for any number of threads.

    Several numbers of clusters are tried, at most those of `options`, where fewer leave room for more components.
    Errors are weighed by the prior, where there is one.

    Args:
        vectors: float [V, D].
        options: as in `encode`; components and formats are chosen.
        budget: of the file.

    Returns:
        what is stored, and the form that was chosen.

    Raises:
        InputError: not even one cluster's mean fits; the least is named.
    """
    vectors = vectors.detach()
    scale = None if options.prior is None else options.prior.to(vectors).sqrt()
    weighted = vectors if scale is None else vectors * scale
    energy = float(weighted.square().sum(1, dtype=torch.float64).mean()) or 1.0
    starts = [_started(weighted, options, budget, clusters) for clusters in _counts(budget, options.clusters)]

    def made(start: _Start, form: Form) -> Encoded:
        means, bases, weights = start.fitted
        fitted = (means, bases[:, : form.components], weights[:, : form.components].contiguous())
        formats = (form.weights_format, form.bases_format)
        stored = stored_form(weighted, start.labels, fitted, scale, *formats)
        return Encoded(start.labels, *stored, options.chosen, *formats, start.counts, start.timings)

    def best(level: tuple[int, bool]) -> tuple[float, tuple[_Start, Form]] | None:
        found = []
        for start in starts:
            for form in budget.forms(start.clusters, level) or budget.forms(start.clusters, level, least=0):
                try:
                    squared = squared_errors(vectors, made(start, form), options.prior)
                except InputError:  # a number beyond float16
                    continue
                found.append((float(squared.mean() / energy) ** 0.5, (start, form)))
        return min(found, key=lambda one: one[0]) if found else None

    start, form = choose(budget.levels, best)
    return made(start, form), form


def _counts(budget: Budget, most: int) -> list[int]:
    """Numbers of clusters that are worth trying: fewer ones where they leave room for more components."""
    found: list[tuple[int, int]] = []
    for clusters in ladder(most):
        room = _room(budget, clusters)
        if room and (not found or room > found[-1][1]):
            found.append((clusters, room))
    if found:
        return [clusters for clusters, _ in found]
    form = most_clusters(budget, most)
    if form is None:
        least, _ = budget.smallest(1, 0)
        budget.refuse(least, "the mean of one cluster", "a mesh of fewer vertices")
    return [form.clusters]


def _room(budget: Budget, clusters: int) -> int:
    """Components that fit in the fewest bits, without giving up openness where one fits beside it."""
    rooms = [budget.forms(clusters, level)[:1] for level in budget.levels]
    kept = [forms[0].components for forms, level in zip(rooms, budget.levels, strict=True) if forms and level[1]]
    return max(kept) if kept else max((forms[0].components for forms in rooms if forms), default=0)


def _started(weighted: torch.Tensor, options: ClusterOptions, budget: Budget, clusters: int) -> _Start:
    components = max(1, min(_room(budget, clusters), _MOST_CLUSTERED))
    found = cluster(weighted, **vars(replace(options, clusters=clusters, components=components)))
    begun = time.perf_counter()
    count = int(found.labels.max()) + 1
    fit = [form.components for level in budget.levels for form in budget.forms(count, level, least=0)]
    fitted = cluster_pca(weighted, found.labels, count, max(fit, default=0))
    counts: dict = {"clusters_dropped": clusters - count, "iterations": found.iterations}
    if found.coherence is not None:
        counts["coherence"] = found.coherence
    return _Start(clusters, found.labels, fitted, counts, {**found.timings, "components": time.perf_counter() - begun})
