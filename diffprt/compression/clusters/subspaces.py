"""Affine subspaces of clusters: fitting them, and how far every vector is from each of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from diffprt.compression.clusters.partition import member_means, members, whole_labels

_CELLS = 1 << 17


@dataclass(frozen=True)
class Subspaces:
    """One affine subspace per cluster.

    Attributes:
        means: float [M, D].
        bases: float [M, P, D], orthonormal rows, or zero beyond a cluster's rank.
    """

    means: torch.Tensor
    bases: torch.Tensor

    def residuals(self, vectors: torch.Tensor) -> torch.Tensor:
        """Squared distance [V, M] of every vector [V, D] to every subspace: |x - m|² - |B (x - m)|².

        One matrix product per component for all clusters. Gradients reach vectors, means and bases.
        """
        distance = vectors.square().sum(1, keepdim=True) - 2 * vectors @ self.means.T + self.means.square().sum(1)
        for basis in self.bases.unbind(1):
            inside = torch.addmm(-(basis * self.means).sum(1), vectors, basis.T)
            distance = torch.addcmul(distance, inside, inside, value=-1)
        return distance.clamp_min(0)

    def blocks(self, vectors: torch.Tensor) -> Iterator[tuple[slice, torch.Tensor]]:
        """`residuals` of runs of rows, so that no temporary grows with V M P."""
        step = max(16, _CELLS // len(self.means))
        for first in range(0, len(vectors), step):
            rows = slice(first, min(first + step, len(vectors)))
            yield rows, self.residuals(vectors[rows])

    def own(self, vectors: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Squared distance [V] of every vector to the subspace of its own cluster."""
        errors = vectors.new_empty(len(vectors))
        for cluster, rows in enumerate(members(labels, len(self.means))):
            away = vectors[rows] - self.means[cluster]
            errors[rows] = away.square().sum(1) - (away @ self.bases[cluster].T).square().sum(1)
        return errors.clamp_min(0)


def fit_subspaces(
    vectors: torch.Tensor,
    labels: torch.Tensor,
    clusters: int,
    components: int,
    *,
    bases: torch.Tensor | None = None,
    passes: int = 2,
    seed: int = 0,
) -> Subspaces:
    """The affine subspace of each cluster, by subspace iteration on its members.

    Args:
        vectors: float [V, D].
        labels: [V], whole numbers of any type in [0, clusters).
        components: P.
        bases: float [M, P, D] to go on from, as those of a similar partition; random without.
        passes: of the iteration; each multiplies what separates the subspace from the best one by the ratio of
            the eigenvalues on either side of the cut.
        seed: of the random start.
    """
    labels = whole_labels(labels, clusters)
    means = member_means(vectors, labels, clusters)
    size = vectors.shape[1]
    kept = min(components, size)
    if bases is None:
        generator = torch.Generator().manual_seed(seed)
        bases = torch.randn(clusters, components, size, generator=generator, dtype=vectors.dtype)
        passes += 3
    centered = [vectors[rows] - mean for rows, mean in zip(members(labels, clusters), means, strict=True)]
    axes = bases[:, :kept].transpose(1, 2).contiguous()
    for _ in range(passes if kept else 0):
        axes = torch.stack([own.T @ (own @ start) for own, start in zip(centered, axes.unbind(), strict=True)])
        axes, triangle = torch.linalg.qr(axes)
        diagonal = triangle.diagonal(dim1=1, dim2=2).abs()
        spanned = diagonal > 1e-5 * diagonal.amax(1, keepdim=True).clamp_min(torch.finfo(vectors.dtype).tiny)
        axes = axes * spanned[:, None]
    fitted = vectors.new_zeros(clusters, components, size)
    fitted[:, :kept] = axes.transpose(1, 2)
    return Subspaces(means, fitted)
