"""Clustered PCA: components of each cluster, weights of its members, decoding, other bases of the same span."""

from __future__ import annotations

import torch

from diffprt.compression.clusters.partition import members, whole_labels

# Values of so few numbers are gathered before they are weighed: the gradient of that takes a quarter of the time.
_NARROW = 8


def cluster_pca(
    vectors: torch.Tensor, labels: torch.Tensor, clusters: int, components: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """The affine subspace that fits each cluster best in least squares.

    Directions that the members do not span are zero, so a cluster with fewer members than components is
    reproduced exactly. The sign of a component makes its largest entry positive.

    Args:
        vectors: float [V, D].
        labels: [V], whole numbers of any type in [0, clusters).
        components: P, at least 0.

    Returns:
        means [M, D], bases [M, P, D] (orthonormal rows, or zero) and weights [V, P], of the vectors' dtype.

    Raises:
        InputError: labels that are no whole numbers or out of range.
    """
    labels = whole_labels(labels, clusters)
    size = vectors.shape[1]
    means = torch.zeros(clusters, size, dtype=torch.float64)
    bases = torch.zeros(clusters, components, size, dtype=torch.float64)
    weights = torch.zeros(len(vectors), components, dtype=torch.float64)
    for cluster, rows in enumerate(members(labels, clusters)):
        if len(rows) == 0:
            continue
        own = vectors[rows].double()
        means[cluster] = own.mean(0)
        centered = own - means[cluster]
        axes = _principal_axes(centered, components)
        bases[cluster, : len(axes)] = axes
        weights[rows] = centered @ bases[cluster].T
    return means.to(vectors.dtype), bases.to(vectors.dtype), weights.to(vectors.dtype)


def blend(labels: torch.Tensor, weights: torch.Tensor, means: torch.Tensor, bases: torch.Tensor) -> torch.Tensor:
    """means[m] + sum_p weights[v, p] bases[m, p] with m = labels[v].

    Since signals act on light linearly, means and bases may be the signal itself, or the signal already applied to the
    light, as a shader has it.

    Args:
        labels: int64 [V], in [0, M).
        weights: float [V, P].
        means: float [M, ...].
        bases: float [M, P, ...], of the dtype of means and weights.

    Returns:
        float [V, ...]. Gradients reach weights, means and bases, second derivatives too.
    """
    if means[0].numel() <= _NARROW:
        return means[labels] + torch.einsum("vp,vp...->v...", weights, bases[labels])
    rows = _Blend.apply(labels, weights, means.flatten(1), bases.flatten(2))
    return rows.unflatten(1, means.shape[1:])


class _Blend(torch.autograd.Function):
    """Decoding in one step over all receivers, its gradient in one product per cluster: each is the faster way."""

    @staticmethod
    def forward(ctx, labels: torch.Tensor, weights: torch.Tensor, means: torch.Tensor, bases: torch.Tensor):
        ctx.save_for_backward(labels, weights, bases)
        # A weighted sum of table rows: gathering first would hold P values of every receiver.
        table = torch.cat([means[:, None], bases], dim=1).flatten(0, 1)
        size = bases.shape[1] + 1
        rows = labels[:, None] * size + torch.arange(size, device=labels.device)
        share = torch.cat([weights.new_ones(len(weights), 1), weights], dim=1)
        return torch.nn.functional.embedding_bag(rows, table, mode="sum", per_sample_weights=share)

    @staticmethod
    def backward(ctx, gradient: torch.Tensor):
        labels, weights, bases = ctx.saved_tensors
        groups = members(labels, len(bases))
        own = [gradient[rows] for rows in groups]
        of_means = torch.stack([part.sum(0) for part in own])
        of_bases = torch.stack([weights[rows].T @ part for rows, part in zip(groups, own, strict=True)])
        of_weights = torch.cat([part @ basis.T for part, basis in zip(own, bases, strict=True)])
        return None, of_weights[torch.cat(groups).argsort()], of_means, of_bases


def orthonormal(bases: torch.Tensor, weights: torch.Tensor, labels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The same blend with orthonormal rows, along the principal axes of each cluster's members by falling spread.

    Args:
        bases: float [M, P, D].
        weights: float [V, P].
        labels: int64 [V].

    Returns:
        bases (rows of no spread are zero) and weights.
    """
    turned, blended = torch.zeros_like(bases), torch.zeros_like(weights)
    for cluster, rows in enumerate(members(labels, len(bases))):
        if len(rows):
            directions, triangle = torch.linalg.qr(bases[cluster].double().T)
            own = weights[rows].double() @ triangle.T
            axes = _principal_axes(own, len(bases[cluster]))
            turned[cluster, : len(axes)] = (axes @ directions.T).to(bases.dtype)
            blended[rows, : len(axes)] = (own @ axes.T).to(weights.dtype)
    return turned, blended


def least_squares(rows: torch.Tensor, means: torch.Tensor, bases: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Weights [V, P] with which means [M, D] and bases [M, P, D], orthonormal or not, come closest to rows [V, D]."""
    weights = rows.new_empty(len(rows), bases.shape[1])
    inverse = torch.linalg.pinv(bases.double(), rtol=1e-6).to(rows.dtype)
    for cluster, own in enumerate(members(labels, len(means))):
        weights[own] = (rows[own] - means[cluster]) @ inverse[cluster]
    return weights


def _principal_axes(centered: torch.Tensor, components: int) -> torch.Tensor:
    """At most `components` orthonormal rows, by falling variance; none of variance zero."""
    count, size = centered.shape
    if components == 0:
        return centered.new_zeros(0, size)
    if count < size:
        values, vectors = torch.linalg.eigh(centered @ centered.T)
        vectors = centered.T @ vectors / values.clamp_min(torch.finfo(torch.float64).tiny).sqrt()
    else:
        values, vectors = torch.linalg.eigh(centered.T @ centered)
    values, vectors = values.flip(0)[:components], vectors.flip(1)[:, :components]
    axes = vectors[:, values > 1e-12 * values.max().clamp_min(1e-300)].T
    return axes * axes.gather(1, axes.abs().argmax(1, keepdim=True)).sign()
