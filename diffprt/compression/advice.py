"""What would bring the error of compressed transfer under a limit, foretold without compressing again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from diffprt.compression.budget import FORMAT_PAIRS, MOST_COMPONENTS
from diffprt.compression.clusters.components import cluster_pca
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.compression.encode import Encoded, encode, squared_errors, stored_form
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions
from diffprt.torch_threads import one_torch_thread

# What is foretold on the clusters at hand stays below this share of the limit: other components, other clusters.
_MARGIN = 0.9
_REMAINDER = 1e-4
_MOST_TRIES = 3


@dataclass(frozen=True)
class Remedy:
    """Options that are foretold to keep the error under a limit.

    Attributes:
        clusters, components, weights_format, bases_format: as in `CompressOptions`.
        relative: the error foretold.
    """

    clusters: int
    components: int
    weights_format: str
    bases_format: str
    relative: float


@one_torch_thread()
def remedy(vectors: torch.Tensor, encoded: Encoded, options: ClusterOptions, limit: float) -> Remedy | None:
    """The fewest components that bring the relative error under `limit`, on the clusters and in the formats at hand.

    Where their rounding alone is over it, finer formats; where even 64 components are not enough, more clusters, which
    then have been tried.

    Args:
        vectors: float [V, D] that were encoded.
        encoded: with an error over the limit.
        options: that it was encoded with.
        limit: of the root of the share of the signal's energy.

    Returns:
        None where nothing that was tried is enough.
    """
    vectors = vectors.detach()
    energy = float(vectors.square().sum(1, dtype=torch.float64).sum()) or 1.0
    clusters, most = len(encoded.means), min(vectors.shape[1], MOST_COMPONENTS)
    wanted = (_MARGIN * limit) ** 2
    span = principal_span(vectors, remainder=_REMAINDER)
    _, _, weights = cluster_pca(span.coordinates, encoded.labels, clusters, most)
    total = _energy_about_means(span.coordinates, encoded.labels, clusters)
    variance = float((vectors - span.mean).square().sum(dtype=torch.float64))
    left = (total - weights.square().sum(0, dtype=torch.float64).cumsum(0) + span.remainder * variance) / energy
    enough = (left <= wanted).nonzero().flatten().tolist()
    if enough:
        count = max(enough[0] + 1, encoded.bases.shape[1])
        widest = min(most, count + max(2, count // 4))
        scale = None if options.prior is None else options.prior.to(vectors).sqrt()
        weighted = vectors if scale is None else vectors * scale
        fitted = cluster_pca(weighted, encoded.labels, clusters, widest)
        for formats in _no_coarser(encoded.weights_format, encoded.bases_format):
            for components in range(count, widest + 1):
                parts = (fitted[0], fitted[1][:, :components], fitted[2][:, :components].contiguous())
                try:
                    stored = stored_form(weighted, encoded.labels, parts, scale, *formats)
                except InputError:  # a number beyond float16
                    break
                found = squared_errors(vectors, Encoded(encoded.labels, *stored, encoded.method, *formats))
                if float(found.sum()) / energy <= wanted:
                    return Remedy(options.clusters, components, *formats, (float(found.sum()) / energy) ** 0.5)
    return _more_clusters(vectors, options, limit, most, energy)


def _more_clusters(
    vectors: torch.Tensor, options: ClusterOptions, limit: float, most: int, energy: float
) -> Remedy | None:
    clusters = options.clusters
    for _ in range(_MOST_TRIES):
        clusters = min(4 * clusters, len(vectors), 1 << 16)
        known = {"clusters": clusters, "components": most, "weights_format": "float32", "bases_format": "float32"}
        found = encode(vectors, **(vars(options) | known))
        relative = (float(squared_errors(vectors, found).sum()) / energy) ** 0.5
        if relative <= limit:
            return Remedy(clusters, most, "float32", "float32", relative)
    return None


def _no_coarser(weights_format: str, bases_format: str) -> Iterator[tuple[str, str]]:
    """The formats at hand, then finer ones."""
    rank = {"uint8": 0, "float16": 1, "float32": 2}
    yield weights_format, bases_format
    for weights, bases in FORMAT_PAIRS:
        finer = rank[weights] >= rank[weights_format] and rank[bases] >= rank[bases_format]
        if finer and (weights, bases) != (weights_format, bases_format):
            yield weights, bases


def _energy_about_means(rows: torch.Tensor, labels: torch.Tensor, clusters: int) -> float:
    """Sum of squared distances to the mean of the own cluster."""
    counts = torch.bincount(labels, minlength=clusters).clamp_min(1).double()
    sums = torch.zeros(clusters, rows.shape[1], dtype=torch.float64).index_add_(0, labels, rows.double())
    return float(rows.double().square().sum() - (sums.square().sum(1) / counts).sum())
