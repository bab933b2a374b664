"""The passes of a glossy bake over runs of receivers: shadows, then bounces.

Receivers are taken along a curve through space (`Receivers.along_curve`): rays of neighbors meet the same triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from diffprt.brdf import hemisphere_gram
from diffprt.options.bake import GlossySettings
from diffprt.sh.frames import frame_rotations, rows_from_frames, tangent_frames
from diffprt.surface.sampling import Pattern
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.chunks import Chunk, Pass, Work
from diffprt.transfer.glossy.bounce import GlossyBouncer
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.visibility_matrix import VisibilityTracer, visibility_order

RAYS_PER_CHUNK = 1 << 19
RECEIVERS_PER_CHUNK = 1024


@dataclass(frozen=True)
class Passed:
    """What passes leave, along the curve: transfer float32 [V, C, K_out, K] without bounces, and with those so far;
    squares of the former's standard error and of itself, float64 [2], summed over receivers."""

    direct: torch.Tensor
    transfer: torch.Tensor
    squares: torch.Tensor


class GlossyPasses(Work[Passed]):
    """Traces and reflects for runs of receivers; results do not depend on how the runs are cut.

    Args:
        surfaces: what occludes and reflects.
        materials: its BRDFs.
        settings: options.
        key: what the bake is known by.

    Attributes:
        order: int64 [V], the receivers in the order in which they are taken: rows count along it.
    """

    heavy = ("_tracer", "_bouncer")

    def __init__(self, surfaces: Surfaces, materials: GlossyMaterials, settings: GlossySettings, key: dict) -> None:
        self._surfaces, self._settings, self.key = surfaces, settings, key
        self.order = surfaces.receivers.along_curve()
        self._receivers = surfaces.receivers.reordered(self.order)
        self.materials = materials.reordered(self.order)
        self.gradients = torch.is_grad_enabled() and materials.reflection.requires_grad
        self._bands = visibility_order(settings.order_out, settings.order)
        self._frames = tangent_frames(self._receivers.normals.double())
        self._exit_weight = hemisphere_gram(settings.order_out, cosine=True)
        self._scramble = surfaces.scramble(self._receivers, settings.seed)
        count = len(self.order)
        bounce = _cut(count, settings.bounce_rays)
        texts = [f"bounce {number} of {settings.bounces}" for number in range(1, settings.bounces + 1)]
        self.passes = (
            Pass("shadow pass", "shadows", _cut(count, settings.rays)),
            *(Pass("light transport", text, bounce) for text in texts),
        )

    @cached_property
    def _tracer(self) -> VisibilityTracer:
        pattern = Pattern.create(self._settings.rays, self._scramble)
        return VisibilityTracer(self._surfaces.mesh(), self._receivers, pattern, self._bands)

    @cached_property
    def _bouncer(self) -> GlossyBouncer:
        pattern = Pattern.create(self._settings.bounce_rays, self._scramble)
        corners, place = self._surfaces.source_of_corner, self.order.argsort()
        corners = torch.where(corners >= 0, place[corners.clamp_min(0)], -1)
        return GlossyBouncer(self._surfaces.mesh(), self._receivers, corners, pattern, self.materials)

    def ready(self, threads: int) -> None:
        self._surfaces.mesh(threads)
        _ = self._tracer, self._settings.reflects and self._bouncer

    def chunk(self, number: int, index: int, before: Passed | None) -> Chunk:
        rows = self.passes[number].cut[index]
        if before is None:
            signal, squares = self.shadows(rows)
            return {"signal": signal, "squares": squares}
        return {"signal": before.direct[rows.start : rows.stop] + self.bounce(rows, before.transfer)}

    def join(self, number: int, chunks: Iterator[Chunk], before: Passed | None) -> Passed:
        parts, squares = [], []
        shape = (len(self.order), *self.materials.shading.shape[1:4])
        whole = torch.empty(0 if self.gradients else shape)
        for rows, found in zip(self.passes[number].cut, chunks, strict=True):
            if self.gradients:
                parts.append(found["signal"])
            else:
                whole[rows.start : rows.stop] = found["signal"]
            if before is None:
                squares.append(found["squares"])
        signal = torch.cat(parts) if self.gradients else whole
        # Summed in the order of the receivers, so that they too have the same bytes for any number of threads.
        if before is not None:
            return replace(before, transfer=signal)
        return Passed(signal, signal, torch.stack(squares).sum(0))

    def shadows(self, rows: range) -> tuple[torch.Tensor, torch.Tensor]:
        """Transfer without bounces.

        Returns:
            float32 [R, C, K_out, K], light on the scene's axes, exit radiance on the receivers' own; and float64 [2],
            the squares of its standard error and of itself, weighed by the cosine of exit and summed.
        """
        rotations = frame_rotations(self._frames[rows.start : rows.stop], self._bands)
        index = self.materials.of_receiver[rows.start : rows.stop]
        visibility, error = self._tracer.trace(rows, rotations)
        local = self.materials.shade(visibility, index)
        both = self.materials.shade(error, index).detach(), local.detach()
        squares = torch.stack([(t * (self._exit_weight @ t)).sum() for t in both])
        turned = rows_from_frames(local.flatten(1, 2), rotations[: self._settings.order])
        return turned.unflatten(1, local.shape[1:3]).float(), squares

    def bounce(self, rows: range, transfer: torch.Tensor) -> torch.Tensor:
        """What one more bounce adds, given `transfer` [V, C, K_out, K] of every receiver before it, along the curve."""
        return self._bouncer.gather(rows, transfer)


def _cut(receivers: int, rays: int) -> list[range]:
    """Runs of receivers that keep a thread busy for a moment."""
    size = max(1, min(RECEIVERS_PER_CHUNK, RAYS_PER_CHUNK // rays))
    return [range(first, min(first + size, receivers)) for first in range(0, receivers, size)]
