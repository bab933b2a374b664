"""Decoding: each receiver's cluster mean plus its weighted components."""

from __future__ import annotations

import torch

# Values of so few numbers are gathered before they are weighed: the gradient of that takes a quarter of the time.
_NARROW = 8


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
        float [V, ...]. Gradients reach weights, means and bases; second derivatives exist where a value has at most
        eight numbers.
    """
    if means[0].numel() <= _NARROW:
        return means[labels] + torch.einsum("vp,vp...->v...", weights, bases[labels])
    # A weighted sum of table rows in one step: gathering first would hold P values of every receiver.
    table = torch.cat([means[:, None], bases], dim=1).flatten(0, 1)
    rows = labels[:, None] * (bases.shape[1] + 1) + torch.arange(bases.shape[1] + 1, device=labels.device)
    share = torch.cat([weights.new_ones(len(weights), 1), weights], dim=1)
    mixed = torch.nn.functional.embedding_bag(rows, table.flatten(1), mode="sum", per_sample_weights=share)
    return mixed.unflatten(1, table.shape[1:])
