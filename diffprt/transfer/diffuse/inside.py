"""Receivers inside other geometry, such as a floor's under a block: found, and filled from those outside.

Nobody sees such a receiver, and nothing lights it; but a triangle that reaches from it to the open is seen, and
interpolation would carry its black out. So it takes the mean of its neighbors outside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.kernels.hemispheres import HemisphereTracer
from diffprt.kernels.launch import run_chunks
from diffprt.surface.operator import BounceOperator, StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.surfaces import Surfaces

# Rays of their own, turned by a number of their own: what is inside follows from the scene alone, so that bakes of any
# rays and any seed agree. Each number of rays sorts receivers out for the next: those that see the open, and those with
# too small a share of backs. Not all are asked for: a ray along a seam of what encloses a receiver may slip in from the
# other side.
_SIEVES = ((2, 0.0), (16, 0.75), (128, 0.95), (256, 0.0))
_PATTERNS = 0x696E73696465
_RECEIVERS_PER_LAUNCH = 1024


def find_inside(surfaces: Surfaces, receivers: Receivers, threads: int | None = None) -> torch.Tensor:
    """Receivers all of whose rays are blocked, and meet backs of triangles.

    One open direction is enough to be outside, so the underside of an open sheet alone encloses nothing; and where
    every ray ends on a back, no line of sight from outside arrives. Winding counts: a scene that is inside out
    has all its receivers inside.

    Args:
        surfaces: what encloses.
        receivers: [V], free ones or those of `surfaces`.
        threads: CPU threads; all that the process may use without it.

    Returns:
        bool [V]; the same for any settings of a bake, seed and rays included.
    """
    mesh = surfaces.mesh(threads)
    origins, normals = receivers.origins(mesh.ray_offset()), receivers.normals
    scramble = surfaces.scramble(receivers, _PATTERNS)
    rows = torch.arange(len(receivers))
    for rays, backs in _SIEVES:
        if len(rows) == 0:
            break
        tracer = HemisphereTracer(mesh, origins[rows], normals[rows], Pattern.create(rays, scramble[rows]))
        rows = rows[_enclosed(tracer, len(rows), backs, threads)]
    inside = torch.zeros(len(receivers), dtype=torch.bool)
    inside[rows] = True
    return inside


def _enclosed(tracer: HemisphereTracer, count: int, backs: float, threads: int | None) -> torch.Tensor:
    """Which of `count` receivers have all rays blocked, that share of them by backs: bool [count]."""
    enclosed = torch.zeros(count, dtype=torch.bool)

    def work(first: int) -> None:
        part = range(first, min(first + _RECEIVERS_PER_LAUNCH, count))
        _, face, _, blocked = tracer.trace(part, hits=backs > 0)
        shut = blocked == tracer.rays
        if backs > 0:
            shut &= blocked - (face >= 0).sum(1) >= backs * tracer.rays
        enclosed[part.start : part.stop] = shut

    for _ in run_chunks(work, range(0, count, _RECEIVERS_PER_LAUNCH), threads=threads):
        pass
    return enclosed


@dataclass(frozen=True)
class Fill:
    """Rows of a signal that are replaced by means of other rows.

    Attributes:
        rows: int64 [B], receivers to fill.
        sources: int64 [U], receivers outside that they are filled from.
        weights: float64 [B, U], each row sums to 1.
        alike: int64 [B], the same number where rows take the same mean.
    """

    rows: torch.Tensor
    sources: torch.Tensor
    weights: StoredOperator
    alike: torch.Tensor

    @staticmethod
    def of_surfaces(surfaces: Surfaces, threads: int | None = None) -> Fill | None:
        """Of the scene's own receivers; None where none can be filled."""
        return Fill.of(surfaces.receivers, find_inside(surfaces, surfaces.receivers, threads))

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
        alike = reached[group[rows]]
        entries = means[alike].tocoo()
        sources, column = np.unique(first[entries.col], return_inverse=True)
        shares = entries.data / np.bincount(entries.row, entries.data)[entries.row]
        weights = sparse.csr_array((shares, (entries.row, column)), shape=(len(rows), len(sources)))
        rows, sources, alike = (torch.from_numpy(part) for part in (rows, sources, alike))
        return Fill(rows, sources, StoredOperator.of(weights), alike)

    def at(self, pick: torch.Tensor) -> tuple[torch.Tensor, StoredOperator, torch.Tensor]:
        """What it takes to fill some receivers alone.

        Args:
            pick: int64 [S], receivers.

        Returns:
            the receivers that are needed, int64 [N], ascending; how each of `pick` follows from them [S, N]; and a
            number for each of `pick` that those with the same mean share, int64 [S].
        """
        from scipy import sparse

        row = torch.full((int(max(self.rows.max(), pick.max())) + 1,), -1)
        row[self.rows] = torch.arange(len(self.rows))
        row = row[pick]
        hidden = row >= 0
        matrix = self.weights.matrix
        parts = (matrix.values().numpy(), matrix.col_indices().numpy(), matrix.crow_indices().numpy())
        means = sparse.csr_array(parts, shape=tuple(matrix.shape))[row[hidden].numpy()].tocoo()
        where = [(~hidden).nonzero()[:, 0], hidden.nonzero()[:, 0][torch.from_numpy(means.row).long()]]
        who = [pick[~hidden], self.sources[torch.from_numpy(means.col).long()]]
        needed, column = torch.cat(who).unique(return_inverse=True)
        values = np.concatenate([np.ones(len(who[0])), means.data])
        at = (torch.cat(where).numpy(), column.numpy())
        follow = StoredOperator.of(sparse.csr_array((values, at), shape=(len(pick), len(needed))))
        # Beyond all numbers of receivers, so that what is filled shares none with what is not.
        alike = pick.clone()
        alike[hidden] = self.alike[row[hidden]] + int(pick.max()) + 1
        return needed, follow, alike

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
