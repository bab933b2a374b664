"""The one pass of diffuse transfer: what the rays of each receiver find, chunk by chunk."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import torch

from diffprt.options.bake import BakeSettings
from diffprt.surface.operator import OperatorRows
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.chunks import Chunk, Pass, Work
from diffprt.transfer.baking.deadline import Pace, spread
from diffprt.transfer.diffuse.direct import DirectTracer, chunk_rows


class Traced(NamedTuple):
    """What all chunks found.

    Attributes:
        sums: float32 [2, rows, K], for `direct_transfer`.
        blocked: int32 [rows], rays.
        rays: int64 [rows], all of them.
        rows: of the bounce operator, chunk by chunk; empty where hits are not kept.
    """

    sums: torch.Tensor
    blocked: torch.Tensor
    rays: torch.Tensor
    rows: list[OperatorRows]


class Tracing(Work[Traced]):
    """Rays of receivers, along a curve through space, against a scene's surfaces.

    Args:
        surfaces: what occludes and reflects.
        receivers: where transfer is wanted.
        settings: order, rays and seed; whether anything reflects.
        scene_hash: of the scene.
        keep_hits: False where the bounce operator is traced again for every product.
        pace: finds the rays of each chunk where the bake has to end in time.

    Attributes:
        cut: the rows of each chunk.
        sides: fronts and backs of the receivers; None where all are opaque.
        order: int64 [rows], the receiver (or side) that each row is.
    """

    heavy = ("tracers",)

    def __init__(
        self,
        surfaces: Surfaces,
        receivers: Receivers,
        settings: BakeSettings,
        *,
        scene_hash: str = "",
        keep_hits: bool = True,
        pace: Pace | None = None,
    ) -> None:
        self.surfaces, self.receivers, self.settings, self.scene_hash = surfaces, receivers, settings, scene_hash
        self.keeps_hits = keep_hits and settings.reflects
        self.sides = Sides.of(receivers)
        traced = receivers if self.sides is None else self.sides.traced
        self.order, self.cut, self.pace = traced.along_curve(), chunk_rows(len(traced), settings.rays), pace
        if pace is not None:
            self.order, self.cut = _spread(self.order, self.cut)
        self.ordered = traced.reordered(self.order)
        self.scramble = surfaces.scramble(self.ordered, settings.seed)
        self.passes = (Pass("visibility and transfer", "tracing", self.cut),)
        self.key = {
            "scene": scene_hash,
            "receivers": traced.hash(),
            **settings.as_dict(),
            "bounces": self.keeps_hits,
            "chunks": "along a curve",
        }

    @cached_property
    def tracers(self) -> Tracers:
        """Trace for transfer, and for hits where they are kept."""
        return Tracers(self, self.settings.order, self.keeps_hits)

    def ready(self, threads: int) -> None:
        self.surfaces.mesh(threads)
        _ = self.tracers

    def chunk(self, number: int, index: int, before: Traced | None) -> Chunk:
        if self.pace is None:
            return self._found(index, self.tracers.of(self.settings.rays))
        rays = self.pace.begin(index, len(self.cut[index]))
        begun = time.monotonic()
        tracer = self.tracers.of(rays)
        self.pace.waited(time.monotonic() - begun)
        found = self._found(index, tracer)
        self.pace.end(index)
        return found | {"rays": torch.full((len(self.cut[index]),), rays)}

    def _found(self, index: int, tracer: DirectTracer) -> Chunk:
        sums, blocked, rows = tracer.trace_rows(self.cut[index])
        found = {"sums": sums, "blocked": blocked}
        if rows is not None:
            found |= {"counts": rows.counts, "columns": rows.columns, "values": rows.values}
        return {name: torch.from_numpy(array) for name, array in found.items()}

    def join(self, number: int, chunks: Iterator[Chunk], before: Traced | None) -> Traced:
        parts = list(chunks)
        rows = [
            OperatorRows(*(p[name].numpy() for name in ("counts", "columns", "values"))) for p in parts if "counts" in p
        ]
        sums, blocked = torch.cat([p["sums"] for p in parts], dim=1), torch.cat([p["blocked"] for p in parts])
        given = torch.tensor([self.settings.rays]).expand(len(blocked))
        return Traced(sums, blocked, torch.cat([p["rays"] for p in parts]) if self.pace is not None else given, rows)


class Tracers:
    """A tracer for each number of rays, of all rows of a pass.

    Attributes:
        work: whose rows they are.
        order: SH bands; 0 for hits alone.
    """

    def __init__(self, work: Tracing, order: int, hits: bool) -> None:
        self.work, self.order, self._hits = work, order, hits
        self._origins = work.ordered.origins(work.surfaces.mesh().ray_offset())
        self._made: dict[int, DirectTracer] = {}
        self._lock = threading.Lock()

    def of(self, rays: int) -> DirectTracer:
        """The tracer of so many rays, made on first use; the one before it may be in use on another thread."""
        with self._lock:
            if rays not in self._made:
                self._made = dict(list(self._made.items())[-1:])
                self._made[rays] = self._tracer(rays)
            return self._made[rays]

    def _tracer(self, rays: int) -> DirectTracer:
        surfaces = self.work.surfaces
        corners = surfaces.source_of_corner.numpy() if self._hits else None
        pattern = Pattern.create(rays, self.work.scramble)
        sources = len(surfaces.receivers)
        return DirectTracer(
            surfaces.mesh(), self.work.ordered, pattern, self.order, corners, sources, origins=self._origins
        )

    def rows(self, chunk: int, rays: int) -> OperatorRows:
        """Rows of G of a chunk."""
        return self.of(rays).trace_rows(self.work.cut[chunk])[2]


def _spread(order: torch.Tensor, cut: list[range]) -> tuple[torch.Tensor, list[range]]:
    """The same chunks in an order of which any first ones lie all over the scene."""
    chosen = [cut[chunk] for chunk in spread(len(cut))]
    stops = list(itertools.accumulate(len(rows) for rows in chosen))
    placed = [range(stop - len(rows), stop) for stop, rows in zip(stops, chosen, strict=True)]
    return torch.cat([order[rows.start : rows.stop] for rows in chosen]), placed
