"""Products of many small vectors that share few matrices, as batches of dense products.

Rays arrive in groups of any size: those of a receiver, or those that end at a source. Groups are padded to the next
power of two, so that less than half of the work is wasted and each batch is one dense product.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch

# Entries of a batch: bounds the memory of padding and of gathered matrices.
_BATCH = 1 << 23


def rows_times_matrices(rows: torch.Tensor, group: torch.Tensor, matrices: torch.Tensor) -> torch.Tensor:
    """rows[n] @ matrices[group[n]].

    Args:
        rows: float [N, A].
        group: int64 [N], in any order.
        matrices: float [G, A, B].
    Returns:
        [N, B]. Gradients reach rows and matrices.
    """
    out, places = [rows.new_zeros(0, matrices.shape[2])], [group.new_zeros(0)]
    for groups, members, filled in _batches(group, rows.shape[1] + matrices.shape[2], matrices[0].numel()):
        product = torch.bmm(rows[members], matrices[groups])
        out.append(product[filled])
        places.append(members[filled])
    return torch.cat(out)[torch.cat(places).argsort()]


def sum_of_outer_products(a: torch.Tensor, b: torch.Tensor, group: torch.Tensor, groups: int) -> torch.Tensor:
    """Σ a[n] b[n]ᵀ over the members n of each group.

    Args:
        a: float [N, A].
        b: float [N, B].
        group: int64 [N] below `groups`, in any order.
    Returns:
        [groups, A, B]. Gradients reach a and b.
    """
    total = a.new_zeros(groups, a.shape[1], b.shape[1])
    for index, members, filled in _batches(group, a.shape[1] + b.shape[1], total[0].numel()):
        left = a[members] * filled[..., None]
        total = total.index_copy(0, index, torch.bmm(left.transpose(1, 2), b[members]))
    return total


def _batches(
    group: torch.Tensor, entries_per_member: int, entries_per_group: int
) -> Iterator[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
    """Groups [S], their members [S, size] (padded with one of them) and which of those count, bool [S, size]."""
    order = group.argsort(stable=True)
    index, counts = torch.unique_consecutive(group[order], return_counts=True)
    starts = counts.cumsum(0) - counts
    size = 1
    while size < 2 * int(counts.max() if len(counts) else 0):
        chosen = torch.nonzero((counts <= size) & (2 * counts > size))[:, 0]
        for some in chosen.split(max(1, _BATCH // (size * entries_per_member + entries_per_group))):
            place = torch.arange(size)
            filled = place < counts[some, None]
            members = order[starts[some, None] + place.minimum(counts[some, None] - 1)]
            yield index[some], members, filled
        size *= 2
