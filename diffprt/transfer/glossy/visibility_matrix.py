"""The shadow pass: visibility in spherical harmonics, and the matrix that it turns light into.

The thesis's matrix (M_p)^0_ij = ∫ V y_i y_j ds over the upper hemisphere (eq. 1) follows exactly from the projection
of V: bands l and l' multiply into bands up to l + l' and no others. So K² sums per ray and vertex are not needed, only
the (2n-1)² sums of one projection, which the packet kernel accumulates as it traces; the products of `diffprt.sh`
do the rest.

The matrix that glossy transfer uses has the cosine in its measure, ∫ V cos θ y_i y_j ds, where the thesis puts it into
the BRDF. The step at the horizon is then part of what is traced and costs the BRDF's matrix no bands
(`diffprt.brdf.fit`).

Source: Chen 2005 (thesis), eq. 1; Sloan, Kautz and Snyder 2002, section 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.brdf import hemisphere_moments
from diffprt.kernels import TriangleMesh
from diffprt.kernels.hemispheres import HemisphereTracer
from diffprt.sh.frames import to_frames
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern


def visibility_order(order_out: int, order_in: int) -> int:
    """Bands of visibility that a matrix between these orders depends on, all of them: fewer would spoil it."""
    return order_out + order_in - 1


@dataclass(frozen=True)
class UniformPattern:
    """Directions spread evenly over the hemisphere, for the thesis's matrix without cosine.

    The kernel lifts the number k of a spiral's point to the height √(1 - (k + shift)/D). Fractional numbers, chosen
    here, make the heights even.
    """

    spiral: torch.Tensor
    rotation: torch.Tensor
    ring_shift: torch.Tensor

    @staticmethod
    def of(pattern: Pattern) -> UniformPattern:
        """The same turns, with even heights."""
        rays = len(pattern.spiral)
        height = 1 - (pattern.spiral[:, 2].double() + 0.5) / rays
        spiral = pattern.spiral.clone()
        spiral[:, 2] = (rays * (1 - height * height)).float()
        return UniformPattern(spiral, pattern.rotation, torch.zeros_like(pattern.ring_shift))


class VisibilityTracer:
    """Projects the visibility of receivers, chunk by chunk.

    Args:
        mesh: what occludes.
        receivers: where.
        pattern: directions: cosine-distributed, then V cos θ is projected; or a `UniformPattern`, then V is.
        order: bands; `visibility_order`.
    """

    def __init__(self, mesh: TriangleMesh, receivers: Receivers, pattern: Pattern | UniformPattern, order: int) -> None:
        self.rays, self.order = len(pattern.spiral), order
        self._cosine = not isinstance(pattern, UniformPattern)
        tables = sh.recurrence_tables(order, torch.float32)
        origins = receivers.origins(mesh.ray_offset())
        self._tracer = HemisphereTracer(mesh, origins, receivers.normals, pattern, order, tables)
        self._open = hemisphere_moments(order, cosine=self._cosine)

    def trace(self, rows: range, rotations: list[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """Visibility of consecutive receivers on the axes of their own frames.

        An open receiver is known exactly; only blocked directions are sampled, or the open ones where they are fewer.

        Args:
            rotations: of `sh.frames.frame_rotations` for these receivers, float64.

        Returns:
            coefficients float64 [R, K], and their standard error, as a difference [R, K] of two halves of the rays.
        """
        sums, _, _, blocked = self._tracer.trace(rows, hits=False)
        even, odd = sums.double()
        whole = math.pi if self._cosine else 2 * math.pi
        mostly_open = (2 * blocked <= self.rays)[:, None]
        value = self._open * mostly_open - whole / self.rays * to_frames(even + odd, rotations)
        counts = (self.rays + 1) // 2, max(self.rays // 2, 1)
        return value, whole / 2 * to_frames(even / counts[0] - odd / counts[1], rotations)
