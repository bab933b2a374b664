"""Signals as plain rows of numbers into clusters, means, components and weights, and the error of that."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import torch

from diffprt.compression.clustered.quantize import rounded, stored_bytes
from diffprt.compression.clustering import cluster
from diffprt.compression.clusters.components import blend, cluster_pca, least_squares, orthonormal
from diffprt.compression.clusters.partition import whole_labels
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions
from diffprt.options.keywords import takes
from diffprt.torch_threads import one_torch_thread

_ROWS = 4096


@dataclass(frozen=True)
class Encoded:
    """Row v is means[m] + weights[v] · bases[m], m = labels[v].

    Attributes:
        labels: int64 [V], in [0, M), given in any integer type; clusters in the order in which rows first meet them.
        means: float [M, D].
        bases: float [M, P, D], orthonormal rows, or zero.
        weights: float [V, P].
        method: how labels were found.
        weights_format, bases_format: how many bits the numbers are rounded to; means go with the bases.
        counts: `clusters_dropped`, `iterations`; `coherence` where the method has one.
        timings: seconds of each step.
    """

    labels: torch.Tensor
    means: torch.Tensor
    bases: torch.Tensor
    weights: torch.Tensor
    method: str
    weights_format: str = "float32"
    bases_format: str = "float32"
    counts: dict = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", whole_labels(self.labels, len(self.means)))

    @property
    def nbytes(self) -> int:
        """Bytes as stored."""
        return encoded_bytes(self.labels, self.means, self.bases, self.weights, self.weights_format, self.bases_format)

    def decode(self, rows: torch.Tensor | slice = slice(None)) -> torch.Tensor:
        """Rows [R, D] as they come back."""
        return blend(self.labels[rows], self.weights[rows], self.means, self.bases)


@takes(ClusterOptions)
@one_torch_thread()
def encode(vectors: torch.Tensor, options: ClusterOptions) -> Encoded:
    """Clustered principal component analysis of any signal; the same for any number of threads.

    Args:
        vectors: float [V, D], such as transfer flattened over channels and coefficients.
        options: see `ClusterOptions` and `CompressOptions`. Clusters beyond the number of distinct rows are dropped and
            counted; components are at most min(D, 64). With a prior, clusters and components are best in the weighted
            error, and worse in the plain one. Means are stored as the bases.

    Returns:
        numbers as they come back from storage. No gradients reach the vectors: `principal_projection` and
        `Subspaces.residuals` have them.

    Raises:
        InputError: an option is out of range, or the method needs faces or positions that are not there.
    """
    most = min(vectors.shape[1], 64)
    if not 0 <= options.components <= most:
        raise InputError(f"components is {options.components}: give 0 to {most}, such as 8")
    vectors = vectors.detach()
    scale = None if options.prior is None else options.prior.to(vectors).sqrt()
    weighted = vectors if scale is None else vectors * scale
    found = cluster(weighted, **vars(options))
    begun = time.perf_counter()
    count = int(found.labels.max()) + 1
    means, bases, weights = cluster_pca(weighted, found.labels, count, options.components)
    means, bases, weights = stored_form(
        weighted, found.labels, (means, bases, weights), scale, options.weights_format, options.bases_format
    )
    counts: dict = {"clusters_dropped": options.clusters - count, "iterations": found.iterations}
    if found.coherence is not None:
        counts["coherence"] = found.coherence
    return Encoded(
        found.labels,
        means,
        bases,
        weights,
        options.chosen,
        options.weights_format,
        options.bases_format,
        counts,
        {**found.timings, "components": time.perf_counter() - begun},
    )


def stored_form(
    weighted: torch.Tensor,
    labels: torch.Tensor,
    fitted: tuple[torch.Tensor, torch.Tensor, torch.Tensor],
    scale: torch.Tensor | None,
    weights_format: str,
    bases_format: str,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Means, bases and weights as they come back from storage.

    Args:
        weighted: float [V, D], the rows times `scale`.
        labels: int64 [V].
        fitted: means, bases and weights that `cluster_pca` found of them.
        scale: float [D], roots of a prior; None without.
        weights_format, bases_format: as in `CompressOptions`.
    """
    means, bases, weights = fitted
    if scale is not None:
        means = means / scale
        bases, weights = orthonormal(bases / scale, weights, labels)
    if bases_format != "float32":
        means = rounded(means[:, None], bases_format)[:, 0]
        bases = rounded(bases, bases_format)
        one = torch.ones_like(means[0]) if scale is None else scale
        weights = least_squares(weighted, means * one, bases * one, labels)
    return means, bases, rounded(weights, weights_format, ranges=labels)


def encoded_bytes(
    labels: torch.Tensor,
    means: torch.Tensor,
    bases: torch.Tensor,
    weights: torch.Tensor,
    weights_format: str = "float32",
    bases_format: str = "float32",
) -> int:
    """Bytes of means, bases, weights and labels (one byte up to 256 clusters, two up to 65536, else four).

    Ranges of uint8 are counted: an offset and a step in float32 for each component of each cluster, and for each
    mean and row of the bases.
    """
    clusters, components = bases.shape[:2]
    label_bytes = 1 if clusters <= 256 else 2 if clusters <= 65536 else 4
    element = means.element_size()
    return (
        stored_bytes(means.numel() + bases.numel(), clusters * (components + 1), bases_format, element)
        + stored_bytes(weights.numel(), clusters * components, weights_format, element)
        + len(labels) * label_bytes
    )


def squared_errors(vectors: torch.Tensor, encoded: Encoded, prior: torch.Tensor | None = None) -> torch.Tensor:
    """Squared error float64 [V] of every row; weighted by `prior` [D] where it is given."""
    result = torch.empty(len(vectors), dtype=torch.float64)
    for first in range(0, len(vectors), _ROWS):
        rows = slice(first, first + _ROWS)
        difference = vectors[rows].detach().double() - encoded.decode(rows).double()
        square = difference.square()
        result[rows] = square.sum(1) if prior is None else square @ prior.double()
    return result
