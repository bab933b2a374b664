"""Projection onto principal components with gradients that survive ties of eigenvalues."""

from __future__ import annotations

import torch

from diffprt.errors import InputError


class _Projector(torch.autograd.Function):
    """The projector onto the leading eigenvectors of a symmetric matrix.

    A projector does not ask which vector of its space is which, so only gaps across the cut are divided by: ties
    among kept or among dropped components are harmless. A tie across the cut has no derivative; there the part of
    the gradient that turns one of the tied components into the other is zero (the basis is frozen).
    """

    @staticmethod
    def forward(ctx, covariance: torch.Tensor, components: int) -> torch.Tensor:
        values, axes = torch.linalg.eigh(covariance)
        ctx.save_for_backward(values, axes)
        ctx.cut = len(values) - components
        kept = axes[:, ctx.cut :]
        return kept @ kept.T

    @staticmethod
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, None]:
        values, axes = ctx.saved_tensors
        dropped, kept = axes[:, : ctx.cut], axes[:, ctx.cut :]
        gap = values[ctx.cut :][None] - values[: ctx.cut][:, None]
        precision = torch.finfo(values.dtype)  # what is divided by a smaller gap is mostly rounding
        tied = gap <= precision.eps**0.5 * values.abs().max().clamp_min(precision.tiny)
        turn = dropped.T @ (gradient + gradient.T) @ kept / gap.masked_fill(tied, torch.inf)
        mixed = dropped @ turn @ kept.T
        return (mixed + mixed.T) / 2, None


def principal_projection(
    vectors: torch.Tensor, components: int, *, members: torch.Tensor | None = None
) -> torch.Tensor:
    """Vectors projected onto the affine subspace that fits them best: mean plus principal components.

    Args:
        vectors: float [V, D].
        components: P, at least 0; D or more leaves the vectors as they are.
        members: float [V], how far each vector belongs, such as a column of a soft assignment; all alike without.

    Returns:
        float [V, D]. Gradients reach the vectors and `members`, through the subspace too, also at ties of
        eigenvalues (hard case 16); where the tie is between the last component kept and the first one dropped, the
        gradient of the subspace along the tied directions is zero. The gradient of the squared error itself is the
        same as with the subspace frozen, since it is the best one.

    Raises:
        InputError: `components` is negative, or the members weigh nothing.
    """
    if components < 0:
        raise InputError(f"components is {components}: give 0 or more, such as 8")
    weight = vectors.new_ones(len(vectors)) if members is None else members
    total = weight.sum()
    if not float(total.detach()) > 0:
        raise InputError("members weigh nothing: give a cluster that has members")
    mean = weight @ vectors / total
    centered = vectors - mean
    if components >= vectors.shape[1]:
        return vectors.clone()
    covariance = centered.T @ (weight[:, None] * centered) / total
    return mean + centered @ _Projector.apply(covariance, components)
