"""Direct transfer and first hits of receivers, chunk by chunk, in Warp."""

from __future__ import annotations

import math

import numpy as np
import torch
import warp as wp

from diffprt import sh
from diffprt.kernels import TriangleMesh, compile_kernels
from diffprt.kernels.direct import blocked_basis_sums
from diffprt.transfer.operator import OperatorRows, rows_from_hits
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.sampling import Pattern

_RAYS_PER_CHUNK = 1 << 18


class DirectTracer:
    """Traces the hemispheres of receivers against a mesh.

    Args:
        mesh: what occludes.
        receivers: where transfer is wanted.
        pattern: directions, one row per receiver.
        order: SH bands.
        source_of_corner: int64 [F, 3], see `rows_from_hits`; None when no bounce is wanted.
        sources: number of sources.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        receivers: Receivers,
        pattern: Pattern,
        order: int,
        source_of_corner: np.ndarray | None,
        sources: int,
    ) -> None:
        compile_kernels(blocked_basis_sums)
        self.mesh, self.order, self.sources = mesh, order, sources
        self.rays = len(pattern.spiral)
        self.count = len(receivers)
        self.source_of_corner = source_of_corner
        self.size = max(1, min(4096, _RAYS_PER_CHUNK // self.rays))
        tables = sh.recurrence_tables(order, torch.float32)
        self._held = [
            receivers.origins(mesh.ray_offset()),
            receivers.normals.float().contiguous(),
            pattern.rotation,
            pattern.ring_shift,
            pattern.spiral,
            *(t.contiguous() for t in tables),
        ]
        origins, normals, rotation, shift, spiral, *tables = self._held
        self._inputs = [
            mesh.id,
            wp.from_torch(origins, dtype=wp.vec3),
            wp.from_torch(normals, dtype=wp.vec3),
            wp.from_torch(rotation, dtype=wp.vec2),
            wp.from_torch(shift),
            wp.from_torch(spiral, dtype=wp.vec2),
            order,
            *(wp.from_torch(t) for t in tables),
        ]

    @property
    def chunks(self) -> int:
        """Number of chunks; the cut does not depend on the number of threads."""
        return math.ceil(self.count / self.size)

    def rows(self, chunk: int) -> range:
        """Receivers of a chunk."""
        return range(chunk * self.size, min((chunk + 1) * self.size, self.count))

    def trace(self, chunk: int) -> tuple[np.ndarray, OperatorRows | None]:
        """Sums of the SH basis over blocked directions, [2, rows, K] (even and odd rays), and rows of G."""
        return self.trace_rows(self.rows(chunk))

    def trace_rows(self, rows: range) -> tuple[np.ndarray, OperatorRows | None]:
        """As `trace`, for any run of receivers."""
        sums = np.zeros((2, len(rows), self.order**2), np.float32)
        want_hits = self.source_of_corner is not None
        shape = (len(rows), self.rays) if want_hits else (1, 1)
        hit_face = np.empty(shape, np.int32)
        hit_weights = np.empty((*shape, 2), np.float32)
        wp.launch(
            blocked_basis_sums,
            len(rows),
            inputs=[*self._inputs, rows.start, int(want_hits)],
            outputs=[_wrap(sums, wp.float32), _wrap(hit_face, wp.int32), _wrap(hit_weights, wp.vec2)],
            device="cpu",
            record_tape=False,
        )
        if not want_hits:
            return sums, None
        return sums, rows_from_hits(hit_face, hit_weights, self.source_of_corner, self.sources)


def _wrap(array: np.ndarray, dtype: type) -> wp.array:
    """A Warp array over numpy memory, without a copy."""
    return wp.array(array, dtype=dtype, device="cpu", copy=False)


def open_transfer(normals: torch.Tensor, order: int) -> torch.Tensor:
    """Transfer [V, K] of receivers that nothing shadows: the clamped cosine about each normal [V, 3]."""
    zonal = sh.clamped_cosine(order, torch.float64)
    return sh.rotate_zonal(zonal, normals.double())


def direct_transfer(normals: torch.Tensor, blocked_sums: torch.Tensor, rays: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Direct transfer from the sums over blocked directions, and the standard error of that estimate.

    Rays are cosine-distributed, so a blocked direction takes pi / D of the basis away. The even and the odd
    rays are two estimates; half their difference is the standard error of their mean if they were
    independent (stratified rays do better, so it errs on the safe side).

    Args:
        normals: [V, 3].
        blocked_sums: float32 [2, V, K].

    Returns:
        float32 [V, 1, K] each.
    """
    order = sh.order_of_count(blocked_sums.shape[2])
    even, odd = blocked_sums.double()
    counts = (rays + 1) // 2, rays // 2
    mean = open_transfer(normals, order) - math.pi / rays * (even + odd)
    error = math.pi / 2 * (even / counts[0] - odd / counts[1]).abs() if counts[1] else torch.full_like(even, torch.nan)
    return mean.float()[:, None], error.float()[:, None]
