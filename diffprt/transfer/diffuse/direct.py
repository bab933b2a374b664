"""Direct transfer and first hits of receivers, chunk by chunk, in Warp."""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt import sh
from diffprt.kernels import TriangleMesh
from diffprt.kernels.hemispheres import HemisphereTracer
from diffprt.surface.operator import OperatorRows
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.transfer.diffuse.interreflection import rows_from_hits

_RAYS_PER_CHUNK = 1 << 18


def chunk_rows(receivers: int, rays: int) -> list[range]:
    """Runs of receivers whose `rays` keep a thread busy for a moment; they do not depend on the number of threads."""
    size = max(1, min(4096, _RAYS_PER_CHUNK // rays))
    return [range(first, min(first + size, receivers)) for first in range(0, receivers, size)]


class DirectTracer:
    """Traces the hemispheres of receivers against a mesh.

    Args:
        mesh: what occludes.
        receivers: where transfer is wanted.
        pattern: directions, one row per receiver.
        order: SH bands; 0 for hits alone.
        source_of_corner: int64 [F, 3], see `rows_from_hits`; None when no bounce is wanted.
        sources: number of sources.
        origins: float32 [V, 3], where rays start, if that is known; see `Receivers.origins`.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        receivers: Receivers,
        pattern: Pattern,
        order: int,
        source_of_corner: np.ndarray | None,
        sources: int,
        origins: torch.Tensor | None = None,
    ) -> None:
        self.count, self.rays, self.sources = len(receivers), len(pattern.spiral), sources
        self.source_of_corner = source_of_corner
        self.cut = chunk_rows(self.count, self.rays)
        tables = sh.recurrence_tables(order, torch.float32) if order else ()
        origins = receivers.origins(mesh.ray_offset()) if origins is None else origins
        self._tracer = HemisphereTracer(mesh, origins, receivers.normals, pattern, order, tables)

    def trace(self, chunk: int) -> tuple[np.ndarray, np.ndarray, OperatorRows | None]:
        """Sums float32 [2, rows, K] and blocked rays int32 [rows] for `direct_transfer`, and rows of G."""
        return self.trace_rows(self.cut[chunk])

    def trace_rows(self, rows: range) -> tuple[np.ndarray, np.ndarray, OperatorRows | None]:
        """As `trace`, for any run of receivers."""
        want_hits = self.source_of_corner is not None
        sums, face, weights, blocked = self._tracer.trace(rows, hits=want_hits)
        operator_rows = None
        if want_hits:
            operator_rows = rows_from_hits(
                face.numpy(), weights.numpy(), self.source_of_corner, self.sources, self.rays
            )
        return sums.numpy(), blocked.numpy(), operator_rows


def open_transfer(normals: torch.Tensor, order: int) -> torch.Tensor:
    """Transfer [V, K] of receivers that nothing shadows: the clamped cosine about each normal [V, 3]."""
    zonal = sh.clamped_cosine(order, torch.float64)
    return sh.rotate_zonal(zonal, normals.double())


def direct_transfer(
    normals: torch.Tensor, sums: torch.Tensor, blocked: torch.Tensor, rays: int | torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Direct transfer from sums over directions, and the standard error of that estimate.

    Rays are cosine-distributed, so a blocked direction takes pi / D of the basis away from what an open receiver
    has; where more than half are blocked, an open direction adds as much to nothing. The even and the odd
    rays are two estimates; half their difference is the standard error of their mean if they were
    independent (stratified rays do better, so it errs on the safe side).

    Args:
        normals: [V, 3].
        sums: float32 [2, V, K], over blocked directions, or minus those over open ones.
        blocked: int [V], number of blocked rays.
        rays: of every receiver, or int64 [V].

    Returns:
        float32 [V, 1, K] each; the error of a single ray is not known, and NaN.
    """
    order = sh.order_of_count(sums.shape[2])
    even, odd = sums.double()
    rays = torch.as_tensor(rays).expand(len(normals))
    start = open_transfer(normals, order) * (2 * blocked <= rays)[:, None]
    mean = start - math.pi / rays[:, None].double() * (even + odd)
    halves = (rays + 1) // 2, torch.where(rays > 1, rays // 2, math.nan)
    error = math.pi / 2 * (even / halves[0][:, None] - odd / halves[1][:, None]).abs()
    return mean.float()[:, None], error.float()[:, None]
