"""Patches: connected receivers of one label, which are moved as one where no receiver would move alone."""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from diffprt.compression.clusters.near import NearErrors
from diffprt.compression.clusters.partition import member_sums
from diffprt.compression.clusters.subspaces import Subspaces
from diffprt.compression.methods.sweep import sweep
from diffprt.compression.overdraw.corners import Corners


def patches(labels: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """The connected patch of equal labels int64 [V] that each receiver belongs to; faces int64 [F, 3]."""
    a, b = torch.cat([faces[:, :2], faces[:, 1:], faces[:, ::2]]).unbind(1)
    same = labels[a] == labels[b]
    rows, columns = a[same].numpy(), b[same].numpy()
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(labels), len(labels)))
    return torch.from_numpy(connected_components(graph, directed=False)[1].astype(np.int64))


def islands(patch: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """The patches int64 [I] that are not the largest of their label; of receivers' patch and label int64 [V]."""
    sizes = torch.bincount(patch)
    of_patch = torch.empty_like(sizes)
    of_patch[patch] = labels
    order = torch.from_numpy(np.lexsort((-sizes.numpy(), of_patch.numpy())))
    later = torch.zeros(len(sizes), dtype=torch.bool)
    later[order[1:]] = of_patch[order[1:]] == of_patch[order[:-1]]
    return later.nonzero().flatten()


def sweep_patches(
    subspaces: Subspaces,
    vectors: torch.Tensor,
    labels: torch.Tensor,
    near: torch.Tensor,
    faces: torch.Tensor,
    prices: list[tuple[float, torch.Tensor]],
) -> torch.Tensor:
    """`sweep` over islands: each joins what surrounds it if that costs less than its shore.

    Args:
        subspaces: of the clusters.
        vectors: float [V, D].
        labels: int64 [V].
        near: int64 [M, N], as `near_clusters`.
        faces: int64 [F, 3].
        prices: as for `sweep`.

    Returns:
        labels int64 [V]; the total never rises.
    """
    patch = patches(labels, faces)
    count = int(patch.max()) + 1
    of_patch = torch.empty(count, dtype=torch.int64)
    of_patch[patch] = labels
    moving = islands(patch, labels)
    members = torch.isin(patch, moving).nonzero().flatten()
    errors = NearErrors.of(subspaces, vectors, labels, near, members).errors
    summed = member_sums(errors[members], patch[members], count)
    corners = Corners.of(patch[faces], count)
    whole = NearErrors(of_patch, near, summed)
    return sweep(whole.of_all, of_patch, corners, len(near), prices, moving)[patch]
