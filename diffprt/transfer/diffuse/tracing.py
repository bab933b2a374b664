"""The one pass of diffuse transfer: what the rays of each receiver find, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import torch

from diffprt.options.bake import BakeSettings
from diffprt.surface.operator import OperatorRows
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.chunks import Chunk, Pass, Work
from diffprt.transfer.diffuse.direct import DirectTracer, chunk_rows

Traced = tuple[torch.Tensor, torch.Tensor, list[OperatorRows]]


class Tracing(Work[Traced]):
    """Rays of receivers, along a curve through space, against a scene's surfaces.

    Args:
        surfaces: what occludes and reflects.
        receivers: where transfer is wanted.
        settings: order, rays and seed; whether anything reflects.
        scene_hash: of the scene.
        keep_hits: False where the bounce operator is traced again for every product.

    Attributes:
        sides: fronts and backs of the receivers; None where all are opaque.
        order: int64 [rows], the receiver (or side) that each row is.
    """

    heavy = ("tracer",)

    def __init__(
        self,
        surfaces: Surfaces,
        receivers: Receivers,
        settings: BakeSettings,
        *,
        scene_hash: str = "",
        keep_hits: bool = True,
    ) -> None:
        self.surfaces, self.receivers, self.settings, self.scene_hash = surfaces, receivers, settings, scene_hash
        self.keeps_hits = keep_hits and settings.reflects
        self.sides = Sides.of(receivers)
        traced = receivers if self.sides is None else self.sides.traced
        self.order = traced.along_curve()
        self.ordered = traced.reordered(self.order)
        self.scramble = surfaces.scramble(self.ordered, settings.seed)
        self.passes = (Pass("visibility and transfer", "tracing", chunk_rows(len(traced), settings.rays)),)
        self.key = {
            "scene": scene_hash,
            "receivers": traced.hash(),
            **settings.as_dict(),
            "bounces": self.keeps_hits,
            "chunks": "along a curve",
        }

    @cached_property
    def tracer(self) -> DirectTracer:
        """Traces for transfer, and for hits where they are kept."""
        return self.make_tracer(self.settings.order, self.keeps_hits)

    def make_tracer(self, order: int, hits: bool) -> DirectTracer:
        """Another tracer of the same rays."""
        surfaces = self.surfaces
        corners = surfaces.source_of_corner.numpy() if hits else None
        pattern = Pattern.create(self.settings.rays, self.scramble)
        return DirectTracer(surfaces.mesh(), self.ordered, pattern, order, corners, len(surfaces.receivers))

    def ready(self, threads: int) -> None:
        self.surfaces.mesh(threads)
        _ = self.tracer

    def chunk(self, number: int, index: int, before: Traced | None) -> Chunk:
        sums, blocked, rows = self.tracer.trace(index)
        found = {"sums": sums, "blocked": blocked}
        if rows is not None:
            found |= {"counts": rows.counts, "columns": rows.columns, "values": rows.values}
        return {name: torch.from_numpy(array) for name, array in found.items()}

    def join(self, number: int, chunks: Iterator[Chunk], before: Traced | None) -> Traced:
        """Sums [2, rows, K] and blocked rays [rows] for `direct_transfer`, and rows of the bounce operator."""
        parts = list(chunks)
        rows = [
            OperatorRows(*(p[name].numpy() for name in ("counts", "columns", "values"))) for p in parts if "counts" in p
        ]
        return torch.cat([p["sums"] for p in parts], dim=1), torch.cat([p["blocked"] for p in parts]), rows
