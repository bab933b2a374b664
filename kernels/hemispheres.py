"""Tracing the hemispheres of receivers: the arrays that `kernels.packets` needs, and runs over all threads."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import torch
import warp as wp

from diffprt.kernels.launch import compile_kernels, run_chunks
from diffprt.kernels.mesh import TriangleMesh
from diffprt.kernels.packets import WIDTH, trace_hemispheres

_RAYS_PER_LAUNCH = 1 << 17


class Pattern(Protocol):
    """Directions of receivers, as `diffprt.surface.sampling.Pattern` makes them."""

    spiral: torch.Tensor
    rotation: torch.Tensor
    ring_shift: torch.Tensor


def packet_lanes(spiral: torch.Tensor) -> torch.Tensor:
    """The table `spiral` [D, 3] (cosine, sine, index) as packets [ceil(D / 16) * 48]; empty lanes have index -1."""
    count = len(spiral)
    padded = torch.tensor([1.0, 0.0, -1.0]).repeat(-(-count // WIDTH) * WIDTH, 1)
    padded[:count] = spiral
    return padded.reshape(-1, WIDTH, 3).transpose(1, 2).contiguous().reshape(-1)


class HemisphereTracer:
    """Traces runs of receivers.

    Args:
        mesh: what blocks.
        origins, normals: float32 [V, 3], where rays start and the axes of the hemispheres.
        pattern: directions.
        order: SH bands to sum over blocked directions; 0 for none.
        tables: `diagonal`, `a`, `b` of `diffprt.sh.recurrence_tables`; empty for order 0.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        origins: torch.Tensor,
        normals: torch.Tensor,
        pattern: Pattern,
        order: int = 0,
        tables: tuple[torch.Tensor, ...] = (),
    ) -> None:
        compile_kernels(trace_hemispheres)
        self.rays, self.order = len(pattern.spiral), order
        self.stride = -(-self.rays // WIDTH) * WIDTH
        tables = [t.float().contiguous() for t in tables] or [torch.zeros(1)] * 3
        self._mesh = mesh
        self._held = [
            packet_lanes(pattern.spiral),
            *(t.float().contiguous() for t in (origins, normals, pattern.rotation, pattern.ring_shift)),
            *tables,
        ]
        lanes, origins, normals, rotation, shift, *tables = self._held
        self._inputs = [
            *mesh.arrays,
            wp.from_torch(lanes),
            self.rays,
            wp.from_torch(origins, dtype=wp.vec3),
            wp.from_torch(normals, dtype=wp.vec3),
            wp.from_torch(rotation, dtype=wp.vec2),
            wp.from_torch(shift),
            order,
            *(wp.from_torch(t) for t in tables),
        ]

    def trace(self, rows: range, *, hits: bool) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Traces consecutive receivers on this thread.

        Returns:
            sums float32 [2, R, K] of the SH basis over blocked directions, or minus those over open directions where
            more than half are blocked (even and odd lanes), hit face int32
            [R, D'] (-1 for none, or its back; D' is a multiple of 16, columns in packet order), barycentric
            coordinates of its first two corners float32 [R, D', 2], both empty without `hits`, and the number of
            blocked rays int32 [R].
        """
        count = len(rows)
        stride = self.stride if hits else 0
        sums = torch.empty(2, count, self.order**2)
        # Not by torch: between its aligned blocks the C library leaves gaps, so that memory grows with every chunk.
        face = torch.from_numpy(np.empty((count, stride), np.int32))
        weights = torch.from_numpy(np.empty((count, stride, 2), np.float32))
        blocked = torch.empty(count, dtype=torch.int32)
        wp.launch(
            trace_hemispheres,
            count,
            inputs=[*self._inputs, int(hits), rows.start, count, stride],
            outputs=[wp.from_torch(t.view(-1)) for t in (sums, face, weights, blocked)],
            device="cpu",
            record_tape=False,
        )
        return sums, face, weights, blocked


def count_blocked(
    mesh: TriangleMesh,
    origins: torch.Tensor,
    normals: torch.Tensor,
    pattern: Pattern,
    *,
    threads: int | None = None,
) -> torch.Tensor:
    """Number of blocked rays of every receiver, int32 [V]: visibility alone."""
    tracer = HemisphereTracer(mesh, origins, normals, pattern)
    blocked = torch.empty(len(origins), dtype=torch.int32)
    step = max(1, _RAYS_PER_LAUNCH // tracer.rays)

    def work(first: int) -> None:
        rows = range(first, min(first + step, len(origins)))
        blocked[rows.start : rows.stop] = tracer.trace(rows, hits=False)[3]

    for _ in run_chunks(work, range(0, len(origins), step), threads=threads):
        pass
    return blocked
