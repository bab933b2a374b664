"""The light-transport pass: what other surfaces send to each receiver, reflected by its BRDF.

The thesis gathers transferred incident radiance, ∫ (1 - V) y_i(s) IR(s) ds, with IR(s) = Σ_k (R_q(B) M_q)_k y_k(-s)
what the hit q sends back along the ray (eq. 2, 3), and multiplies by the BRDF's matrix afterwards. Both are linear, so
here each ray is reflected at once: T_p += (π/D) b(s) (y(-s)ᵀ T_q), with b(s) the receiver's exit coefficients for light
from s. T_q is exit radiance on the axes of q, so that turning the direction into q's frame replaces the rotated BRDF.

One misprint of the thesis is not followed. Eq. 2 adds to M^(b-1) what M^(b-1) itself sends, which counts the first
bounce b times; transfer after b bounces is T_b = T_0 + G T_(b-1).

Source: Chen 2005 (thesis), eq. 2 and 3; Sloan, Kautz and Snyder 2002, section 5.
"""

from __future__ import annotations

import math

import torch

from diffprt import sh
from diffprt.kernels import TriangleMesh
from diffprt.kernels.hemispheres import HemisphereTracer
from diffprt.sh.frames import tangent_frames
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.transfer.glossy.grouped_products import rows_times_matrices, sum_of_outer_products
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.mirrored import above_horizon

# Powers of it choose corners of hit triangles; it is not related to the golden ratio of the directions.
_PLASTIC = 0.7548776662466927


class GlossyBouncer:
    """Gathers reflected light, chunk by chunk.

    Args:
        mesh: all triangles.
        receivers: which are also the sources.
        source_of_corner: int64 [F, 3]: receiver at each face corner, -1 where nothing reflects.
        pattern: cosine-distributed directions.
        materials: BRDFs.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        receivers: Receivers,
        source_of_corner: torch.Tensor,
        pattern: Pattern,
        materials: GlossyMaterials,
    ) -> None:
        self._pattern, self._corners, self._materials = pattern, source_of_corner, materials
        self._frames = tangent_frames(receivers.normals)
        origins = receivers.origins(mesh.ray_offset())
        self._tracer = HemisphereTracer(mesh, origins, receivers.normals, pattern)

    def gather(self, rows: range, transfer: torch.Tensor) -> torch.Tensor:
        """What one more bounce adds to consecutive receivers.

        Args:
            transfer: [V, C, K_out, K] of every source, before this bounce.

        Returns:
            [R, C, K_out, K], light on the scene's axes, exit radiance on the receivers' own. Gradients reach
            `transfer` and the BRDFs.
        """
        row, source, incoming, leaving = self._hits(rows)
        towards = sh.basis(leaving, self._materials.order_out).to(transfer.dtype)
        reflected = self._materials.reflect(incoming, self._materials.of_receiver[rows.start + row]).to(transfer.dtype)
        reflected = reflected * (math.pi / len(self._pattern.spiral))
        gathered = []
        # Channel by channel, because one product for all would first copy the transfer of every source.
        for channel in range(transfer.shape[1]):
            emitted = rows_times_matrices(towards, source, transfer[:, channel])
            gathered.append(sum_of_outer_products(reflected[:, channel], emitted, row, len(rows)))
        return torch.stack(gathered, dim=1)

    def _hits(self, rows: range) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Rays that end on a surface that reflects.

        One corner of the triangle stands for the hit, chosen with its barycentric weight as probability: as good as
        all three on average, at a third of the work.

        Returns:
            row [N] below the number of rows, source [N], direction of the ray on the receiver's axes [N, 3], and
            back along the ray on the source's axes [N, 3].
        """
        _, face, weights, _ = self._tracer.trace(rows, hits=True)
        row, ray = torch.nonzero(face >= 0, as_tuple=True)
        first, second = weights[row, ray].unbind(-1)
        chosen = torch.frac((ray + 1) * _PLASTIC + self._pattern.ring_shift[rows.start + row].double())
        corner = (chosen > first).long() + (chosen > first + second).long()
        source = self._corners[face[row, ray].long(), corner]
        row, ray, source = (t[source >= 0] for t in (row, ray, source))
        incoming = self._directions(rows.start + row, ray)
        backward = -torch.einsum("nij,nj->ni", self._frames[rows.start + row], incoming)
        leaving = torch.einsum("nij,ni->nj", self._frames[source], backward)
        return row, source, incoming, above_horizon(leaving)

    def _directions(self, receiver: torch.Tensor, ray: torch.Tensor) -> torch.Tensor:
        """Directions [N, 3] of rays on their receivers' axes, as the kernel makes them."""
        pattern = self._pattern
        cosine, sine, index = pattern.spiral[ray].unbind(-1)
        turn_cosine, turn_sine = pattern.rotation[receiver].unbind(-1)
        square = (index + pattern.ring_shift[receiver]) / len(pattern.spiral)
        radius = square.sqrt()
        x = radius * (cosine * turn_cosine - sine * turn_sine)
        y = radius * (cosine * turn_sine + sine * turn_cosine)
        return torch.stack([x, y, (1 - square).clamp_min(0).sqrt()], dim=-1)
