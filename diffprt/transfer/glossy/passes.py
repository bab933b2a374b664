"""The passes of a glossy bake over runs of receivers: shadows, then bounces.

Receivers are taken along a curve through space (`Receivers.along_curve`): rays of neighbors meet the same triangles.
"""

from __future__ import annotations

import torch

from diffprt.brdf import hemisphere_gram
from diffprt.kernels import TriangleMesh
from diffprt.options.bake import GlossySettings
from diffprt.sh.frames import frame_rotations, rows_from_frames, tangent_frames
from diffprt.surface.sampling import Pattern
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.glossy.bounce import GlossyBouncer
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.visibility_matrix import VisibilityTracer, visibility_order


class GlossyPasses:
    """Traces and reflects for runs of receivers; results do not depend on how the runs are cut.

    Args:
        surfaces: what occludes and reflects.
        mesh: its triangles.
        materials: its BRDFs.
        settings: options.

    Attributes:
        order: int64 [V], the receivers in the order in which they are taken: rows count along it.
    """

    def __init__(
        self, surfaces: Surfaces, mesh: TriangleMesh, materials: GlossyMaterials, settings: GlossySettings
    ) -> None:
        self.order = surfaces.receivers.along_curve()
        receivers = surfaces.receivers.reordered(self.order)
        place = torch.empty_like(self.order)
        place[self.order] = torch.arange(len(self.order))
        corners = surfaces.source_of_corner
        corners = torch.where(corners >= 0, place[corners.clamp_min(0)], -1)
        self._materials = materials.reordered(self.order)
        self._bands, self._order_in = visibility_order(settings.order_out, settings.order), settings.order
        self._frames = tangent_frames(receivers.normals.double())
        self._exit_weight = hemisphere_gram(settings.order_out, cosine=True)
        scramble = receivers.scramble(settings.seed, surfaces.positions.amin(0), surfaces.diagonal)
        self._tracer = VisibilityTracer(mesh, receivers, Pattern.create(settings.rays, scramble), self._bands)
        self._bouncer = None
        if settings.reflects:
            pattern = Pattern.create(settings.bounce_rays, scramble)
            self._bouncer = GlossyBouncer(mesh, receivers, corners, pattern, self._materials)

    def shadows(self, rows: range) -> tuple[torch.Tensor, torch.Tensor]:
        """Transfer without bounces.

        Returns:
            float32 [R, C, K_out, K], light on the scene's axes, exit radiance on the receivers' own; and float64 [2],
            the squares of its standard error and of itself, weighed by the cosine of exit and summed.
        """
        rotations = frame_rotations(self._frames[rows.start : rows.stop], self._bands)
        index = self._materials.of_receiver[rows.start : rows.stop]
        visibility, error = self._tracer.trace(rows, rotations)
        local = self._materials.shade(visibility, index)
        both = self._materials.shade(error, index).detach(), local.detach()
        squares = torch.stack([(t * (self._exit_weight @ t)).sum() for t in both])
        turned = rows_from_frames(local.flatten(1, 2), rotations[: self._order_in])
        return turned.unflatten(1, local.shape[1:3]).float(), squares

    def bounce(self, rows: range, transfer: torch.Tensor) -> torch.Tensor:
        """What one more bounce adds, given `transfer` [V, C, K_out, K] of every receiver before it, along the curve."""
        return self._bouncer.gather(rows, transfer)
