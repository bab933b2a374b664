"""Weights in eight bits whose levels go where they are needed: components of small spread lend theirs to large ones.

With 256 levels each, the widest component of a cluster is rounded far more coarsely than the narrowest. Let components
i and j have steps s_i >> s_j. The row of j is tilted towards i,

    b_j' = b_j + s_i / (n s_j) b_i,   n = sqrt(s_i / s_j),

so that one step of j also moves i by s_i / n. Among n neighboring levels of j one brings i within s_i / 2n, and j stays
within n s_j / 2: both errors are sqrt(s_i s_j) / sqrt(12), where their squares were s_i² / 12 and s_j² / 12. It is the
rate allocation of transform coding (Huang and Schultheiss 1963) by a skewed lattice: decoding is the same linear blend,
only rounding looks at two weights at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.compression.clustered.quantize import LEVELS, rounded, spans
from diffprt.compression.clusters.partition import members

# Below this ratio of steps nothing is gained; above the other, rounding would look at too many levels.
_LEAST_RATIO, _MOST_NEIGHBORS = 4.0, 48.0


@dataclass(frozen=True)
class Pairs:
    """Which components lend levels to which, in every cluster.

    Attributes:
        wide, narrow: int64 [M, N] component numbers of each pair.
        neighbors: float [M, N], n; 1 where nothing is lent.
    """

    wide: torch.Tensor
    narrow: torch.Tensor
    neighbors: torch.Tensor


def tilt(bases: torch.Tensor, weights: torch.Tensor, labels: torch.Tensor) -> tuple[torch.Tensor, Pairs]:
    """Bases whose narrow rows are tilted towards wide ones.

    Args:
        bases: float [M, P, D], orthonormal rows, or zero.
        weights: float [V, P] of the receivers.
        labels: int64 [V].

    Returns:
        bases [M, P, D], and the pairs.
    """
    step = spans(weights, labels, len(bases))[1]
    order = step.argsort(dim=1, descending=True)
    half = bases.shape[1] // 2
    wide, narrow = order[:, :half], order.flip(1)[:, :half]
    large, small = step.gather(1, wide), step.gather(1, narrow)
    lends = (small > 0) & (large >= _LEAST_RATIO * small)
    ratio = torch.where(lends, large / small.clamp_min(torch.finfo(step.dtype).tiny), torch.ones_like(large))
    neighbors = ratio.sqrt().clamp_max(_MOST_NEIGHBORS)
    slope = torch.where(lends, ratio / neighbors, torch.zeros_like(ratio))
    tilted = bases.clone()
    rows = torch.arange(len(bases))[:, None]
    tilted[rows, narrow] += slope[..., None] * bases[rows, wide]
    return tilted, Pairs(wide, narrow, torch.where(lends, neighbors, torch.ones_like(neighbors)))


def fine_weights(
    rows: torch.Tensor, means: torch.Tensor, bases: torch.Tensor, labels: torch.Tensor, pairs: Pairs
) -> torch.Tensor:
    """Weights in eight bits, float32 [V, P], for which means and bases come close to `rows`.

    Args:
        rows: float [V, D].
        means, bases: [M, D] and [M, P, D] as they come back from storage, from `tilt`.
        pairs: from `tilt`.

    Returns:
        values that survive storage as they are (`rounded`).
    """
    result = torch.zeros(len(rows), bases.shape[1], dtype=torch.float64)
    for m, own in enumerate(members(labels, len(means))):
        if len(own):
            away = rows[own].double() - means[m].double()
            result[own] = _cluster_weights(away, bases[m].double(), pairs.wide[m], pairs.narrow[m], pairs.neighbors[m])
    return rounded(result.float(), "uint8", ranges=labels)


def _cluster_weights(
    rows: torch.Tensor, bases: torch.Tensor, wide: torch.Tensor, narrow: torch.Tensor, neighbors: torch.Tensor
) -> torch.Tensor:
    """Weights [N, P] of one cluster's rows [N, D], less its mean."""
    ideal = rows @ torch.linalg.pinv(bases, rtol=1e-9)
    result = ideal.clone()
    gram = bases @ bases.T
    paired = torch.cat([wide, narrow])
    for p in set(range(len(bases))) - set(paired.tolist()):
        low, step = _grid(ideal[:, p], ideal[:, p].argmin(), ideal[:, p].argmax())
        result[:, p] = _level(ideal[:, p], low, step) * step + low
    for i, j, n in zip(wide.tolist(), narrow.tolist(), neighbors.tolist(), strict=True):
        result[:, i], result[:, j] = _pair(ideal[:, i], ideal[:, j], gram[i, i], gram[i, j], gram[j, j], n)
    return result


def _pair(
    wide: torch.Tensor, narrow: torch.Tensor, ii: torch.Tensor, ij: torch.Tensor, jj: torch.Tensor, neighbors: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """The levels of two components that together come closest to both.

    Storage spans a range from the least to the greatest weight that occurs, so that some receivers' levels are the
    first and the last. Those of the wide one are its extremes. Those of the narrow one have its range moved by less
    than `neighbors` steps, to where the wide one meets them without error.
    """
    low_i, step_i = _grid(wide, wide.argmin(), wide.argmax())
    first, last = int(narrow.argmin()), int(narrow.argmax())
    slope = float(ij / ii) if float(ii) > 0 else 0.0
    tied = neighbors > 1 and slope != 0.0
    ends = []
    for end in (first, last):
        off = float((wide[end] - low_i) / step_i.clamp_min(1e-300))
        ends.append(float(narrow[end]) + ((off - round(off)) * float(step_i) / slope if tied else 0.0))
    low_j, step_j = torch.tensor(ends[0]).to(narrow), torch.tensor(max(ends[1] - ends[0], 0.0) / LEVELS).to(narrow)
    middle = _level(narrow, low_j, step_j)
    reach = int(neighbors / 2 + 1) if tied else 0
    best = torch.full_like(narrow, torch.inf)
    chosen = [torch.zeros_like(narrow), torch.zeros_like(narrow)]
    for offset in range(-reach, reach + 1):
        level_j = (middle + offset).clamp(0, LEVELS)
        level_j[first], level_j[last] = 0, LEVELS
        away_j = low_j + level_j * step_j - narrow
        level_i = _level(wide - slope * away_j, low_i, step_i)
        level_i[wide.argmin()], level_i[wide.argmax()] = 0, LEVELS
        away_i = low_i + level_i * step_i - wide
        cost = ii * away_i.square() + 2 * ij * away_i * away_j + jj * away_j.square()
        better = cost < best
        best = torch.where(better, cost, best)
        chosen = [torch.where(better, level, old) for level, old in zip((level_i, level_j), chosen, strict=True)]
    return low_i + chosen[0] * step_i, low_j + chosen[1] * step_j


def _grid(values: torch.Tensor, first: torch.Tensor, last: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Offset and step of the levels from one value to another."""
    return values[first], (values[last] - values[first]) / LEVELS


def _level(values: torch.Tensor, low: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
    """Nearest levels; 0 where there is but one."""
    return ((values - low) / torch.where(step > 0, step, 1.0)).round().clamp(0, LEVELS) * (step > 0)
