"""Super-clusters: which clusters share a pass, so that triangles between them are drawn once (Sloan et al. 2003)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from diffprt.compression.clusters.partition import whole_labels
from diffprt.compression.overdraw.overdraw import draws, overdraw
from diffprt.errors import InputError

SELECTIONS = ("greedy", "search")
_SWAP_CELLS = 1 << 30
_MOST_SLOTS = 1 << 13


@dataclass(frozen=True)
class SuperClusters:
    """Clusters grouped into passes.

    Attributes:
        groups: int64 [M], the pass of each cluster.
        passes: number of passes.
        overdraw: average triangle overdraw once grouped (thesis 2005, equation 8).
    """

    groups: torch.Tensor
    passes: int
    overdraw: float


def clusters_per_pass(budget: int, components: int, *, channels: int = 1, outputs: int = 1) -> int:
    """How many clusters fit into the registers of a pass (thesis 2005, section 4.1).

    A cluster needs outputs x (components + 1) x channels / 4 float4 registers: its mean and components, already
    dotted with the light.

    Args:
        budget: float4 registers of the graphics card, such as 256, 1024 or 4096.
        components: P.
        channels: 1 or 3.
        outputs: 1 for diffuse transfer, K_out for glossy.

    Raises:
        InputError: not one cluster fits.
    """
    floats = outputs * (components + 1) * channels
    if 4 * budget < floats:
        raise InputError(
            f"a register budget of {budget} float4 holds no cluster, which needs {floats / 4:g}: "
            "give more registers or fewer components"
        )
    return 4 * budget // floats


def super_clusters(
    labels: torch.Tensor,
    faces: torch.Tensor,
    per_pass: int,
    *,
    selection: str = "search",
    groups: torch.Tensor | None = None,
) -> SuperClusters:
    """Groups clusters into passes of at most `per_pass` so that triangles are drawn seldom.

    Args:
        labels: [V], in [0, M), whole numbers of any type.
        faces: int64 [F, 3].
        per_pass: as `clusters_per_pass` counts.
        selection: "greedy" is the thesis's algorithm; "search" goes on from there by chains of swaps (up
            to 8192 clusters; more stay greedy).
        groups: int64 [M] to go on from with "search", in place of the greedy ones.

    Raises:
        InputError: there are no faces, `per_pass` is below 1, or `selection` is unknown.

    Source: thesis 2005, figure 4.6; swaps after Kernighan and Lin 1970.
    """
    if selection not in SELECTIONS:
        raise InputError(f"super-cluster selection '{selection}' is unknown: use one of {', '.join(SELECTIONS)}")
    if per_pass < 1:
        raise InputError(f"per_pass is {per_pass}: give 1 or more clusters in a pass")
    labels = whole_labels(labels)
    overdraw(labels, faces)
    clusters = int(labels.max()) + 1
    mixed = labels[faces[draws(labels, faces) > 1]]
    if groups is None:
        groups = _greedy(torch.bincount(labels, minlength=clusters), mixed, per_pass)
    if selection == "search":
        groups = _search(groups, mixed, per_pass)
    _, packed = torch.unique(groups, return_inverse=True)
    return SuperClusters(packed, int(packed.max()) + 1, overdraw(packed[labels], faces))


def _greedy(sizes: torch.Tensor, mixed: torch.Tensor, per_pass: int) -> torch.Tensor:
    """Figure 4.6: begin with the fullest cluster left, then add whichever spares most draws of what is there."""
    clusters = len(sizes)
    corners = mixed.numpy()
    groups = np.full(clusters, -1)
    left = sizes.numpy().astype(np.int64)
    for group in range(-(-clusters // per_pass)):
        chosen = int(np.where(groups < 0, left, -1).argmax())
        touched = np.zeros(len(corners), dtype=bool)
        for _ in range(per_pass):
            groups[chosen] = group
            touched |= (corners == chosen).any(1)
            open_ = groups < 0
            if not open_.any():
                break
            near = np.sort(corners[touched], axis=1)
            near[:, 1:][near[:, 1:] == near[:, :-1]] = clusters  # a label counts once per triangle
            spared = np.bincount(near.reshape(-1), minlength=clusters + 1)[:clusters]
            # where nothing is spared, the fullest: it would otherwise begin a pass of its own
            chosen = int(np.where(open_, spared * (left.sum() + 1) + left, -1).argmax())
    return torch.from_numpy(groups)


def _search(groups: torch.Tensor, mixed: torch.Tensor, per_pass: int) -> torch.Tensor:
    """Chains of best swaps, each kept up to where it was best, while the overdraw falls."""
    clusters, passes = len(groups), -(-len(groups) // per_pass)
    slots = passes * per_pass  # empty slots are clusters that no triangle has
    if passes < 2 or len(mixed) == 0 or slots > _MOST_SLOTS:
        return groups
    shared = np.zeros((slots, slots), dtype=np.float32)
    corners = mixed.numpy()
    for one, two in ((0, 1), (1, 2), (2, 0)):
        a, b = corners[:, one], corners[:, two]
        np.add.at(shared, (a[a != b], b[a != b]), 1.0)
        np.add.at(shared, (b[a != b], a[a != b]), 1.0)
    two_only = draws_of(corners) == 2
    for one, two in ((0, 1), (1, 2), (2, 0)):  # a triangle of two labels has two such edges, and spares one draw
        pick = two_only & (corners[:, one] != corners[:, two])
        np.add.at(shared, (corners[pick, one], corners[pick, two]), -0.5)
        np.add.at(shared, (corners[pick, two], corners[pick, one]), -0.5)
    best = np.empty(slots, dtype=np.int64)
    best[:clusters] = groups.numpy()
    best[clusters:] = np.repeat(np.arange(passes), per_pass - np.bincount(best[:clusters], minlength=passes))
    best_drawn = draws_of(best[corners]).sum()
    steps = max(1, _SWAP_CELLS // slots**2)
    while steps > 0:
        chain, drawn = _chain(best, shared, corners, passes, min(steps, slots // 2))
        steps -= slots // 2
        if drawn >= best_drawn:
            break
        best, best_drawn = chain, drawn
    return torch.from_numpy(best[:clusters].copy())


def _chain(
    start: np.ndarray, shared: np.ndarray, corners: np.ndarray, passes: int, steps: int
) -> tuple[np.ndarray, int]:
    """Swaps of two clusters, always the best left, even at a loss; the best grouping on the way and its draws."""
    slots = len(start)
    groups = start.copy()
    member = np.zeros((slots, passes), dtype=np.float32)
    member[np.arange(slots), groups] = 1.0
    toward = shared @ member
    free = np.ones(slots, dtype=bool)
    best, best_drawn, since = start, np.iinfo(np.int64).max, 0
    for _ in range(steps):
        gain = toward[:, groups] - toward[np.arange(slots), groups][:, None]
        gain = gain + gain.T - 2 * shared
        gain[groups[:, None] == groups] = -np.inf
        gain[~free] = -np.inf
        gain[:, ~free] = -np.inf
        a, b = divmod(int(gain.argmax()), slots)
        if not np.isfinite(gain[a, b]):
            break
        for cluster, old, new in ((a, groups[a], groups[b]), (b, groups[b], groups[a])):
            toward[:, old] -= shared[:, cluster]
            toward[:, new] += shared[:, cluster]
        groups[a], groups[b] = groups[b], groups[a]
        free[[a, b]] = False
        drawn, since = int(draws_of(groups[corners]).sum()), since + 1
        if drawn < best_drawn:
            best, best_drawn, since = groups.copy(), drawn, 0
        if since > 24:
            break
    return best, best_drawn


def draws_of(labels: np.ndarray) -> np.ndarray:
    """Number of different labels in each row of `labels` [N, 3]."""
    a, b, c = labels.T
    return 1 + (a != b) + ((c != a) & (c != b))
