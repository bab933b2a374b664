"""Receivers inside other geometry, such as a floor's under a block: found, and filled from those outside.

Nobody sees such a receiver, and nothing lights it; but a triangle that reaches from it to the open is seen, and
interpolation would carry its black out. So it takes the mean of its neighbors outside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.kernels.hemispheres import HemisphereTracer
from diffprt.surface.operator import BounceOperator, StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern

_RAYS = 128
_RECEIVERS_PER_LAUNCH = 1024
# Not all: a ray along a seam of what encloses a receiver may slip in from the other side.
_BACK_SHARE = 0.95


def find_inside(
    mesh: TriangleMesh, receivers: Receivers, blocked: torch.Tensor, rays: int, scramble: torch.Tensor, threads: int
) -> torch.Tensor:
    """Receivers all of whose rays are blocked, and meet backs of triangles.

    One open direction is enough to be outside, so the underside of an open sheet alone encloses nothing; and where
    every ray ends on a back, no line of sight from outside arrives. Winding counts: a scene that is inside out
    has all its receivers inside.

    Args:
        blocked: int [V], of `rays` rays each.
        scramble: int64 [V], see `Receivers.scramble`.

    Returns:
        bool [V].
    """
    inside = torch.zeros(len(receivers), dtype=torch.bool)
    dark = (blocked == rays).nonzero()[:, 0]
    if len(dark) == 0:
        return inside
    origins = receivers.origins(mesh.ray_offset())[dark]
    tracer = HemisphereTracer(mesh, origins, receivers.normals[dark], Pattern.create(_RAYS, scramble[dark]))
    backs = torch.zeros(len(dark), dtype=torch.int64)

    def work(first: int) -> None:
        rows = range(first, min(first + _RECEIVERS_PER_LAUNCH, len(dark)))
        _, face, _, hits = tracer.trace(rows, hits=True)
        backs[rows.start : rows.stop] = hits.long() - (face >= 0).sum(1)

    for _ in run_chunks(work, range(0, len(dark), _RECEIVERS_PER_LAUNCH), threads=threads):
        pass
    inside[dark] = backs >= _BACK_SHARE * _RAYS
    return inside


@dataclass(frozen=True)
class Fill:
    """Rows of a signal that are replaced by means of other rows.

    Attributes:
        rows: int64 [B], receivers to fill.
        sources: int64 [U], receivers outside that they are filled from.
        weights: float64 [B, U], each row sums to 1.
    """

    rows: torch.Tensor
    sources: torch.Tensor
    weights: StoredOperator

    @staticmethod
    def of(receivers: Receivers, inside: torch.Tensor) -> Fill | None:
        """Fills receivers `inside` [V] from the mesh around them; None where there is nothing to fill, or to fill from.

        Next to the outside a receiver takes the mean of its neighbors there, weighted by the inverse of their
        distance; further in, what the receiver it is reached from takes. Receivers that share position and normal
        (seams) are one.
        """
        if not bool(inside.any()) or len(receivers.faces) == 0:
            return None
        from scipy import sparse  # most scenes do without, and it takes a tenth of a second to load

        group = receivers.coincident()
        first = np.unique(group, return_index=True)[1]
        hidden = inside.numpy()[first]
        start, end = _edges(group[receivers.faces.numpy()])
        positions = receivers.positions.double().numpy()[first]
        length = np.linalg.norm(positions[start] - positions[end], axis=1)
        rim = hidden[start] & ~hidden[end]
        count = len(first)
        nearness = 1 / np.maximum(length[rim], 1e-12 * length.max(initial=1e-300))
        means = sparse.csr_array((nearness, (start[rim], end[rim])), shape=(count, count))
        reached, layer = np.full(count, -1), np.unique(start[rim])
        reached[layer] = layer
        while len(layer):
            step = np.isin(start, layer) & hidden[end] & (reached[end] < 0)
            layer, at = np.unique(end[step], return_index=True)
            reached[layer] = reached[start[step][at]]
        rows = np.flatnonzero(inside.numpy() & (reached[group] >= 0))
        if len(rows) == 0:
            return None
        entries = means[reached[group[rows]]].tocoo()
        sources, column = np.unique(first[entries.col], return_inverse=True)
        shares = entries.data / np.bincount(entries.row, entries.data)[entries.row]
        weights = sparse.csr_array((shares, (entries.row, column)), shape=(len(rows), len(sources)))
        return Fill(torch.from_numpy(rows), torch.from_numpy(sources), StoredOperator.of(weights))

    def apply(self, signal: torch.Tensor) -> torch.Tensor:
        """`signal` [V, ...] with rows filled; a new tensor, without gradients."""
        filled = signal.clone()
        filled[self.rows] = _in_double(self.weights.product, signal[self.sources])
        return filled

    def transposed(self, signal: torch.Tensor) -> torch.Tensor:
        """The transposed map."""
        spread = signal.clone()
        spread[self.rows] = 0
        spread[self.sources] += _in_double(self.weights.transposed(), signal[self.rows])
        return spread


def _in_double(product: Callable[[torch.Tensor], torch.Tensor], signal: torch.Tensor) -> torch.Tensor:
    """A product with `signal` [V, ...], found in float64, in its own dtype."""
    return product(signal.flatten(1).double()).to(signal.dtype).unflatten(1, signal.shape[1:])


class FilledOperator(BounceOperator):
    """A bounce operator whose rows inside geometry are means of rows outside, as direct transfer's are."""

    def __init__(self, operator: BounceOperator, fill: Fill) -> None:
        self.receivers, self.sources, self.entries = operator.receivers, operator.sources, operator.entries
        self._operator, self._fill = operator, fill

    def product(self, dense: torch.Tensor) -> torch.Tensor:
        return self._fill.apply(self._operator.product(dense))

    def transposed(self) -> Callable[[torch.Tensor], torch.Tensor]:
        before = self._operator.transposed()
        return lambda dense: before(self._fill.transposed(dense))


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both directions of every edge of `faces` [F, 3], each once, ascending."""
    one, two = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    pairs = np.unique(np.stack([np.r_[one, two], np.r_[two, one]], axis=1), axis=0)
    return pairs[:, 0], pairs[:, 1]
