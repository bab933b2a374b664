"""Values on a surface from pixels of it: sparse least squares with neighbors that differ little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import torch

from diffprt.errors import InputError
from diffprt.inverse.observations import Observation
from diffprt.surface import Receivers

# So small a pull towards the middle of [0, 1] decides only where no neighbor is told anything.
_PULL = 1e-9


@dataclass(frozen=True)
class SurfaceFit:
    """Solves for one value x per receiver: pixels are P diag(f) x, with a factor f for each receiver and picture.

    The estimate is the most probable one where pixels have independent noise and values differ along every edge of a
    triangle by a normal deviate.

    Attributes:
        contributions: P of each picture, [M, S].
        seen: int64 [S] of each picture, its receivers.
        smooth: [V, V], the quadratic form of what edges are expected to differ, in units of squared pixels.
        join: [V, groups], 1 where a receiver belongs to a group of one value; None where each has its own. Groups that
            no picture shows get 0.5.
    """

    contributions: list[scipy.sparse.csr_array]
    seen: list[np.ndarray]
    smooth: scipy.sparse.csc_array
    join: scipy.sparse.csr_array | None

    @staticmethod
    def of(
        receivers: Receivers,
        observations: Sequence[Observation],
        *,
        groups: torch.Tensor | None = None,
        variation: float,
        noise: float,
    ) -> SurfaceFit:
        """For pixels whose noise is `noise` of their root mean square, and edges that differ by `variation`."""
        variance = noise**2 * sum(o.power for o in observations) / (3 * sum(len(o.radiance) for o in observations))
        return SurfaceFit(
            [o.contributions() for o in observations],
            [o.frozen.seen.numpy() for o in observations],
            # Groups tell where values may jump, so that edges between them tell nothing.
            edge_differences(receivers) * (variance / variation**2 if groups is None else 0.0),
            None if groups is None else _membership(groups),
        )

    def solve(
        self, factors: Sequence[np.ndarray], pixels: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Values, how much of each is told by pixels rather than by neighbors, and the sum of squares left.

        Args:
            factors: float64 [S] for each picture.
            pixels: float64 [M] for each picture.

        Returns:
            float64 [V], [V] in [0, 1], and a number.
        """
        count = self.smooth.shape[0]
        designs = []
        for weights, seen, factor in zip(self.contributions, self.seen, factors, strict=True):
            scaled = weights.multiply(factor[None]).tocoo()
            entries = (scaled.data, (scaled.row, seen[scaled.col]))
            designs.append(scipy.sparse.csr_array(entries, shape=(scaled.shape[0], count)))
        design, target = scipy.sparse.vstack(designs).tocsr(), np.concatenate(pixels)
        normal = (design.T @ design).tocsc()
        data = normal.diagonal()
        if not data.max() > 0:
            raise InputError("the lights do not reach what the pictures show: check lights and cameras")
        pull = _PULL * data.max()
        matrix = (normal + self.smooth + pull * scipy.sparse.identity(count, format="csc")).tocsc()
        right = design.T @ target + 0.5 * pull
        if self.join is None:
            values = scipy.sparse.linalg.splu(matrix).solve(right)
        else:
            joined = (self.join.T @ matrix @ self.join).toarray()
            values = self.join @ np.linalg.solve(joined, self.join.T @ right)
            data = self.join @ (self.join.T @ data)
        told = data / (data + self.smooth.diagonal() + pull)
        return values, told, float(np.square(design @ values - target).sum())


def edge_differences(receivers: Receivers) -> scipy.sparse.csc_array:
    """Laplacian of the graph of triangle edges [V, V]: xᵀ L x is the sum of (x_i - x_j)² over edges.

    Receivers at one position (seams) count as neighbors too.
    """
    faces = receivers.faces
    pairs = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, place = receivers.positions.unique(dim=0, return_inverse=True)
    order = place.argsort(stable=True)
    same = place[order[1:]] == place[order[:-1]]
    pairs = torch.cat([pairs, torch.stack([order[1:][same], order[:-1][same]], dim=1)]).sort(dim=1).values.unique(dim=0)
    first, second = pairs[pairs[:, 0] != pairs[:, 1]].numpy().T
    count, ones = len(receivers), np.ones(len(first))
    edges = scipy.sparse.coo_array((ones, (first, second)), shape=(count, count))
    edges = (edges + edges.T).tocsc()
    return (scipy.sparse.diags_array(edges.sum(axis=0)) - edges).tocsc()


def _membership(groups: torch.Tensor) -> scipy.sparse.csr_array:
    """[V, number of groups], 1 where a receiver belongs."""
    _, index = groups.unique(return_inverse=True)
    return scipy.sparse.csr_array((np.ones(len(groups)), (np.arange(len(groups)), index.numpy())))
