"""Per-vertex reclassification: receivers join a neighbor's cluster where that costs little (Sloan et al. 2003)."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.compression.clusters.near import NearErrors, near_clusters
from diffprt.compression.clusters.partition import Clustering
from diffprt.compression.clusters.subspaces import Subspaces, fit_subspaces
from diffprt.compression.methods.geometry_coherence import by_nearest_member
from diffprt.compression.methods.label_descent import sweep
from diffprt.compression.methods.lbg import by_means
from diffprt.compression.overdraw.corners import Corners
from diffprt.options.compress import ClusterOptions

_SWEEPS, _TOLERANCE = 16, 0.5


def reclassify(
    vectors: torch.Tensor,
    labels: torch.Tensor,
    subspaces: Subspaces,
    corners: Corners,
    *,
    tolerance: float = _TOLERANCE,
) -> torch.Tensor:
    """Moves receivers to clusters of their neighbors wherever that lowers overdraw and the error permits it.

    A receiver may move if its own squared error grows by at most `tolerance` times the mean squared error that
    all receivers had at the start. Subspaces stay as they are; refit afterwards. Our reading of Sloan et al. 2003,
    whose rule the 2005 thesis uses as "overdraw reduction" without stating it.

    Args:
        vectors: float [V, D].
        labels: int64 [V].
        subspaces: of the clusters.
        corners: of the mesh.
        tolerance: at least 0, growth of a receiver's error that is permitted.

    Returns:
        labels int64 [V]. No gradients.
    """
    clusters = len(subspaces.means)
    near = NearErrors.of(subspaces, vectors, labels, near_clusters(subspaces, vectors, labels, corners))
    first = labels
    own = subspaces.own(vectors, labels)
    limit = own + tolerance * own.mean()
    # Errors within the limit count as next to nothing, so that overdraw decides and the error only breaks ties.
    small = 1e-3 / float(limit.max().clamp_min(torch.finfo(vectors.dtype).tiny))

    def cost(units: torch.Tensor) -> torch.Tensor:
        residual = near.of_all(units)
        permitted = residual <= limit[units][:, None]
        permitted.scatter_(1, first[units][:, None], True)
        return torch.where(permitted, small * residual, torch.inf)

    prices = [(1.0, torch.arange(clusters))]
    for _ in range(_SWEEPS):
        before = labels
        labels = sweep(cost, labels, corners, clusters, prices)
        if torch.equal(before, labels):
            break
    return labels


def by_means_reclassified(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "lbg-reclassified"."""
    found = by_means(vectors, options)
    tolerance = _TOLERANCE if options.coherence is None else options.coherence
    return replace(_joined(vectors, found, options, tolerance), coherence=options.coherence)


def by_nearest_member_reclassified(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "lbg-coherent-reclassified"."""
    return _joined(vectors, by_nearest_member(vectors, options), options, _TOLERANCE)


def _joined(vectors: torch.Tensor, found: Clustering, options: ClusterOptions, tolerance: float) -> Clustering:
    subspaces = fit_subspaces(vectors, found.labels, int(found.labels.max()) + 1, options.components)
    corners = Corners.of(options.faces, len(vectors))
    return replace(found, labels=reclassify(vectors, found.labels, subspaces, corners, tolerance=tolerance))
