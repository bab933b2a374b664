"""Squared errors of receivers in the clusters that they may want: those near their own, by signal or on the mesh.

A round of clustering that asks every receiver about every subspace takes V M (P + 1) D products, although all but a
few clusters are hopeless for all members of another. Those few are found on a sample of members.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import csr_matrix

from diffprt.compression.clusters.partition import members
from diffprt.compression.clusters.subspaces import Subspaces
from diffprt.compression.overdraw.corners import Corners

_NEAR = 20
_SAMPLE = 8
_CELLS = 1 << 22


@dataclass(frozen=True)
class NearErrors:
    """Squared errors of every receiver in the clusters near its own.

    Attributes:
        labels: int64 [V], the own cluster of every receiver.
        near: int64 [M, N], the clusters near each.
        errors: float [V, N], of receiver v in cluster near[labels[v], n].
    """

    labels: torch.Tensor
    near: torch.Tensor
    errors: torch.Tensor

    @staticmethod
    def of(
        subspaces: Subspaces,
        vectors: torch.Tensor,
        labels: torch.Tensor,
        near: torch.Tensor,
        units: torch.Tensor | None = None,
    ) -> NearErrors:
        """Of vectors float [V, D] in clusters int64 [V]: one product per cluster, whose members share their rivals.

        Where `units` int64 [U] are given, rows of others are infinite.
        """
        units = torch.arange(len(vectors)) if units is None else units
        errors = vectors.new_full((len(vectors), near.shape[1]), torch.inf)
        for cluster, places in enumerate(members(labels[units], len(near))):
            if len(places):
                rows, rivals = units[places], near[cluster]
                errors[rows] = _errors(
                    vectors[rows] - subspaces.means[cluster],
                    subspaces.means[rivals] - subspaces.means[cluster],
                    subspaces.bases[rivals],
                )
        return NearErrors(labels, near, errors)

    def nearest(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The cluster int64 [V] of least error, and that error [V]."""
        errors, column = self.errors.min(1)
        return self.near[self.labels].gather(1, column[:, None])[:, 0], errors

    def of_all(self, units: torch.Tensor) -> torch.Tensor:
        """Errors [U, M] of receivers int64 [U] in all clusters, infinite in those that are not near."""
        found = self.errors.new_full((len(units), len(self.near)), torch.inf)
        return found.scatter_(1, self.near[self.labels[units]], self.errors[units])


def _errors(vectors: torch.Tensor, means: torch.Tensor, bases: torch.Tensor) -> torch.Tensor:
    """Squared distances [n, N] of vectors [n, D] to subspaces through means [N, D] along bases [N, P, D]."""
    distance = torch.addmm(means.square().sum(1), vectors, means.T, alpha=-2)
    distance += vectors.square().sum(1, keepdim=True)
    offsets = torch.bmm(bases, means[:, :, None])[:, :, 0]
    inside = torch.addmm(-offsets.T.flatten(), vectors, bases.transpose(0, 1).flatten(0, 1).T)
    for along in inside.unflatten(1, (bases.shape[1], len(means))).unbind(1):
        distance.addcmul_(along, along, value=-1)
    return distance.clamp_min_(0)


def near_clusters(
    subspaces: Subspaces, vectors: torch.Tensor, labels: torch.Tensor, corners: Corners | None = None
) -> torch.Tensor:
    """The clusters int64 [M, N] that members of each may want: itself, those across an edge, those of least excess.

    The excess is how much a member's error would grow, least over a sample of members. N is at most 20.

    Args:
        subspaces: of the M clusters.
        vectors: float [V, D].
        labels: int64 [V]; the rows of empty clusters mean nothing.
        corners: of the mesh; without, no cluster is across an edge from another.
    """
    clusters = len(subspaces.means)
    kept = min(_NEAR, clusters)
    if kept == clusters:
        return torch.arange(clusters).expand(clusters, clusters)
    beside = _beside(labels, corners, clusters)
    counts = torch.bincount(labels, minlength=clusters)
    steps = torch.arange(_SAMPLE) * counts[:, None] // _SAMPLE
    places = (counts.cumsum(0) - counts)[:, None] + steps
    sample = labels.argsort(stable=True)[places.clamp_max(len(labels) - 1)]
    near = torch.empty(clusters, kept, dtype=torch.int64)
    step = max(1, _CELLS // (_SAMPLE * clusters))
    for first in range(0, clusters, step):
        own = torch.arange(first, min(first + step, clusters))
        errors = subspaces.residuals(vectors[sample[own].flatten()]).unflatten(0, (len(own), _SAMPLE))
        excess = (errors - errors.gather(2, own[:, None, None].expand(-1, _SAMPLE, 1))).amin(1)
        wanted = torch.from_numpy(beside[first : first + len(own)].toarray() > 0)
        excess = torch.where(wanted, excess - 4 * float(excess.abs().max()), excess)
        near[own] = excess.scatter(1, own[:, None], -torch.inf).topk(kept, largest=False, sorted=False).indices
    return near


def _beside(labels: torch.Tensor, corners: Corners | None, clusters: int) -> csr_matrix:
    """How many corners of triangles clusters share, [M, M]."""
    if corners is None:
        return csr_matrix((clusters, clusters), dtype=np.int32)
    rows = labels[corners.unit].repeat(2).numpy()
    columns = labels[torch.cat([corners.first, corners.second])].numpy()
    return csr_matrix((np.ones(len(rows), dtype=np.int32), (rows, columns)), shape=(clusters, clusters))
