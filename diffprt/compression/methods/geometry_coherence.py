"""Geometry coherence: a receiver is drawn to clusters that have a member near it (thesis 2005, section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from diffprt.compression.clusters.partition import Clustering, Partition, canonical, member_means, nearest
from diffprt.compression.methods.lbg import fill_empty, start_centers
from diffprt.compression.methods.starts import unit_box
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions
from diffprt.surface.operator import OperatorRows, StoredOperator

PLACES = ("nearest", "mean")
_ALPHA = 0.05
_ROWS = 4096


def nearest_member(positions: torch.Tensor, labels: torch.Tensor, cluster: int, queries: torch.Tensor) -> torch.Tensor:
    """Equation 10: distance [Q] from receivers int64 [Q] to the nearest member of a cluster, by a tree.

    A member is at distance 0 from its own cluster, as the equation has it, and a cluster without members infinitely
    far.
    """
    members = (labels == cluster).nonzero().flatten()
    if len(members) == 0:
        return torch.full((len(queries),), torch.inf, dtype=positions.dtype)
    return torch.from_numpy(cKDTree(positions[members].numpy()).query(positions[queries].numpy())[0])


def lbg_coherent(
    vectors: torch.Tensor,
    positions: torch.Tensor,
    clusters: int,
    *,
    alpha: float = _ALPHA,
    place: str = "nearest",
    start: str = "k-means++",
    seed: int = 0,
    iterations: int = 50,
    tolerance: float = 1e-4,
) -> Partition:
    """LBG with |V - mean| + alpha times the distance to the cluster in space (thesis 2005, equations 9 and 10).

    The first round goes by the means alone, for nobody is a member yet. What follows depends on the reading:
    "nearest" is equation 10, the distance to the nearest member, which is 0 in a receiver's own cluster. It holds
    receivers back in what the first round gave them. "mean" is the distance to the mean position of the members, as
    the text around the equation may be read ("the Gaussian distances of positions", as of vectors): clusters become
    compact in space, which is what the thesis's tables show.

    Args:
        vectors: float [V, D].
        positions: float [V, 3], in any unit: scaled into the unit box.
        clusters: at most this many.
        alpha: weight of geometry, at least 0. The thesis's tables have 0.05, in units of its meshes and signals,
            which it does not state.
        place: one of `PLACES`.
        start, seed, iterations, tolerance: as in `lbg`; the tolerance is of the sum of what is minimized.

    Raises:
        InputError: alpha is negative, `place` is unknown, or as `lbg`.
    """
    if not alpha >= 0:
        raise InputError(f"alpha is {alpha}: give 0 or more, such as 0.05")
    if place not in PLACES:
        raise InputError(f"place '{place}' is unknown: use one of {', '.join(PLACES)}")
    assign = _assign if place == "nearest" else _assign_by_mean
    centers = start_centers(vectors, clusters, start, seed)
    count, points = len(centers), unit_box(positions)
    labels = nearest(vectors, centers)[0]
    before, done = float("inf"), 0
    while done < iterations:
        done += 1
        labels = fill_empty(vectors, labels, count)
        labels, total = assign(vectors, points, labels, member_means(vectors, labels, count), alpha)
        if total == 0.0 or before - total <= tolerance * before < float("inf"):
            break
        before = total
    labels, names = canonical(labels)
    centers = member_means(vectors, labels, len(names))
    energy = (vectors - centers[labels]).square().sum(1).double().sum()
    return Partition(labels, centers, float(energy), done)


def by_nearest_member(vectors: torch.Tensor, options: ClusterOptions, *, place: str = "nearest") -> Clustering:
    """The method "lbg-coherent"."""
    alpha = _ALPHA if options.coherence is None else options.coherence
    found = lbg_coherent(vectors, options.positions, options.clusters, alpha=alpha, place=place, **options.lbg)
    return Clustering(found.labels, found.iterations, alpha)


def by_mean_position(vectors: torch.Tensor, options: ClusterOptions) -> Clustering:
    """The method "lbg-coherent-mean"."""
    return by_nearest_member(vectors, options, place="mean")


def _assign(
    vectors: torch.Tensor, points: torch.Tensor, labels: torch.Tensor, centers: torch.Tensor, alpha: float
) -> tuple[torch.Tensor, float]:
    """The label of least equation 9, and the sum of that.

    Exact without asking every cluster about every receiver: geometry only adds, so a cluster whose mean alone is
    farther than what the receiver has already cannot win.
    """
    distance = _distances(vectors, centers)
    best = distance.gather(1, labels[:, None])[:, 0].double()
    chosen = labels.clone()
    for cluster in range(len(centers)):
        rivals = ((distance[:, cluster] < best) & (labels != cluster)).nonzero().flatten()
        if len(rivals):
            energy = distance[rivals, cluster] + alpha * nearest_member(points, labels, cluster, rivals)
            wins = energy < best[rivals]
            best[rivals[wins]], chosen[rivals[wins]] = energy[wins], cluster
    return chosen, float(best.sum())


def _assign_by_mean(
    vectors: torch.Tensor, points: torch.Tensor, labels: torch.Tensor, centers: torch.Tensor, alpha: float
) -> tuple[torch.Tensor, float]:
    """The same with the distance to the mean position of the members."""
    places = member_means(points, labels, len(centers)).to(vectors.dtype)
    energy = _distances(vectors, centers).add_(torch.cdist(points.to(vectors.dtype), places), alpha=alpha)
    best, chosen = energy.min(1)
    return chosen, float(best.sum(dtype=torch.float64))


def _distances(vectors: torch.Tensor, centers: torch.Tensor) -> torch.Tensor:
    norms = centers.square().sum(1)
    blocks = [
        (rows.square().sum(1, keepdim=True) + norms - 2 * rows @ centers.T).clamp_min(0).sqrt()
        for rows in vectors.split(_ROWS)
    ]
    return torch.cat(blocks)


@dataclass(frozen=True)
class NearestMembers:
    """A smooth form of equation 10 for soft clusters, prepared for many assignments of the same receivers.

    Attributes:
        nearness: exp(-|P_i - P_k| / width) [V, V] of each receiver's neighbors; geometry is constant.
        beyond: float64 [V, 1], the same of the farthest one, at whose distance everything beyond counts.
        width: over which the minimum is softened.
    """

    nearness: StoredOperator
    beyond: torch.Tensor
    width: float

    @staticmethod
    def of(positions: torch.Tensor, *, width: float = 0.01, neighbors: int = 32, itself: bool = True) -> NearestMembers:
        """As `smooth_nearest_member`; without `itself`, no receiver counts as a member near itself."""
        points = positions.detach().double().numpy()
        skipped = 0 if itself else 1
        count = min(neighbors + skipped, len(points))
        distance, index = (found.reshape(len(points), count) for found in cKDTree(points).query(points, k=count))
        near = np.exp(-distance / width)
        if not itself:
            near[index == np.arange(len(points))[:, None]] = 0.0
        order = index.argsort(axis=1)
        columns, values = (np.take_along_axis(found, order, axis=1).reshape(-1) for found in (index, near))
        rows = OperatorRows(np.full(len(points), count, dtype=np.int32), columns.astype(np.int32), values)
        return NearestMembers(StoredOperator([rows], len(points)), torch.from_numpy(near[:, -1:].copy()), width)

    def distance(self, assignment: torch.Tensor) -> torch.Tensor:
        """-width log sum_k q_kj exp(-|P_i - P_k| / width), [V, M], of q float [V, M]; gradients reach it."""
        beyond = self.beyond.to(assignment).clamp_min(torch.finfo(assignment.dtype).tiny)
        return -self.width * (self.nearness.gather(assignment) + beyond).log()


def smooth_nearest_member(
    positions: torch.Tensor, assignment: torch.Tensor, *, width: float = 0.01, neighbors: int = 32
) -> torch.Tensor:
    """A smooth form of equation 10 for soft clusters: -width log sum_k q_kj exp(-|P_i - P_k| / width), [V, M].

    Only the nearest receivers are summed; what is farther than all of them counts as at their distance, so the
    result is at most the farthest neighbor's distance.

    Args:
        positions: float [V, 3]; geometry is constant, no gradients reach it.
        assignment: float [V, M], in [0, 1].
        width: over which the minimum is softened, in units of the positions (unit box: 0.01).
        neighbors: receivers to sum over, itself included.

    Returns:
        float [V, M], towards the distance to the nearest member as `width` falls and q becomes hard; it may be
        below it by width log(neighbors). Gradients reach the assignment.
    """
    return NearestMembers.of(positions, width=width, neighbors=neighbors).distance(assignment)
