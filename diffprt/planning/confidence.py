"""One-sided 95 % bounds from pilot rays."""

from __future__ import annotations

import torch

CONFIDENCE = 0.95
_Z = 1.645


def share_below(successes: int, trials: int) -> float:
    """Upper bound of a probability (Clopper and Pearson 1934).

    It also holds for independent trials of unequal probabilities, for their mean (Hoeffding 1956).
    """
    from scipy.special import betaincinv

    return 1.0 if successes >= trials else float(betaincinv(successes + 1, trials - successes, CONFIDENCE))


def mean_below(values: torch.Tensor) -> torch.Tensor:
    """Upper bound of the mean of `values` [M, ...] over receivers, at least 0."""
    return (values.mean(0) + _Z * _error(values)).clamp_min(0)


def mean_above(values: torch.Tensor) -> torch.Tensor:
    """Lower bound of the mean of `values` [M, ...] over receivers, at least 0."""
    return (values.mean(0) - _Z * _error(values)).clamp_min(0)


def _error(values: torch.Tensor) -> torch.Tensor:
    """Standard error of the mean; none is known of a single receiver, whose walks are then many."""
    return values.std(0) / len(values) ** 0.5 if len(values) > 1 else torch.zeros_like(values[0])
