"""Patches: connected receivers of one label, which are moved as one where no receiver would move alone."""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from diffprt.compress.corners import Corners
from diffprt.compress.partition import member_sums
from diffprt.compress.subspaces import Subspaces
from diffprt.compress.sweep import sweep


def patches(labels: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """The connected patch of equal labels int64 [V] that each receiver belongs to; faces int64 [F, 3]."""
    a, b = torch.cat([faces[:, :2], faces[:, 1:], faces[:, ::2]]).unbind(1)
    same = labels[a] == labels[b]
    rows, columns = a[same].numpy(), b[same].numpy()
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(labels), len(labels)))
    return torch.from_numpy(connected_components(graph, directed=False)[1].astype(np.int64))


def sweep_patches(
    vectors: torch.Tensor,
    labels: torch.Tensor,
    faces: torch.Tensor,
    subspaces: Subspaces,
    prices: list[tuple[float, torch.Tensor]],
) -> torch.Tensor:
    """`sweep` over whole patches: an island joins what surrounds it if that costs less than its shore.

    Args:
        vectors: float [V, D].
        labels: int64 [V].
        faces: int64 [F, 3].
        subspaces: of the clusters.
        prices: as for `sweep`.

    Returns:
        labels int64 [V]; the total never rises.
    """
    patch = patches(labels, faces)
    count, clusters = int(patch.max()) + 1, len(subspaces.means)
    cost = torch.zeros(count, clusters, dtype=vectors.dtype)
    for rows, residual in subspaces.blocks(vectors):
        here, index = patch[rows].unique(return_inverse=True)
        cost[here] += member_sums(residual, index, len(here))
    of_patch = torch.empty(count, dtype=torch.int64)
    of_patch[patch] = labels
    corners = Corners.of(patch[faces], count)
    return sweep(lambda units: cost[units], of_patch, corners, clusters, prices)[patch]
