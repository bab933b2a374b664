"""What rays of a diffuse bake cost on this machine, as it is just now: measured, for a bake that has to end in time."""

from __future__ import annotations

import time

import torch

from diffprt.kernels import run_chunks
from diffprt.options.bake import CONVERGED, BakeSettings
from diffprt.surface.operator import OperatorRows, StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.deadline import Cost
from diffprt.transfer.diffuse.direct import DirectTracer
from diffprt.transfer.diffuse.estimate import PRODUCTS, spread_receivers

_FEW, _MANY = 64, 1024
_RECEIVERS, _PER_CHUNK = 1024, 64
# What the end of a bake takes for certain: writing, flushing to disk, leaving the interpreter.
_ENDING = 0.35
# Seconds for each value of the signal: certificate, openness, writing.
_VALUE = 4e-8


def measured_cost(
    surfaces: Surfaces, receivers: Receivers, settings: BakeSettings, threads: int, *, stored: bool
) -> tuple[Cost, float]:
    """Traces some receivers with few and with many rays, on all threads, as the bake will.

    Args:
        receivers: all that will be traced.
        stored: whether the bounce operator is kept, or traced again for every product.

    Returns:
        the cost, and the entries that a row of the bounce operator has for each ray.
    """
    mesh = surfaces.mesh(threads)
    picked = spread_receivers(receivers, _RECEIVERS)
    sides = Sides.of(picked)
    picked = picked if sides is None else sides.traced
    corners = surfaces.source_of_corner.numpy() if settings.reflects else None
    sources = len(surfaces.receivers)

    def traced(rays: int) -> tuple[float, list[OperatorRows]]:
        pattern = surfaces.pattern(picked, rays, settings.seed)
        tracer = DirectTracer(mesh, picked, pattern, settings.order, corners, sources)
        rows: dict[int, OperatorRows | None] = {}

        def work(first: int) -> None:
            rows[first] = tracer.trace_rows(range(first, min(first + _PER_CHUNK, len(picked))))[2]

        begun = time.perf_counter()
        for _ in run_chunks(work, range(0, len(picked), _PER_CHUNK), threads=threads):
            pass
        return time.perf_counter() - begun, [row for row in rows.values() if row is not None]

    traced(_FEW)
    few = min(traced(_FEW)[0], traced(_FEW)[0])
    many, rows = traced(_MANY)
    side, ray = straight(few, many, len(picked))
    values = len(receivers) * (3 if settings.reflects and surfaces.colored else 1) * settings.order**2
    per_row, per_entry = _operator_cost(rows, sources, settings, values // len(receivers)) if rows else (0.0, 0.0)
    products = PRODUCTS if settings.bounces == CONVERGED else settings.bounces
    again = 0 if stored else products

    def tail(rays: int) -> float:
        # Rays meet the same surfaces again and again, so that entries grow slower than rays: this errs on the safe side
        # where they are many.
        entries = receivers.sides * min(per_row * rays / _MANY, sources)
        return _ENDING + _VALUE * values + entries * per_entry + again * receivers.sides * (side + ray * rays)

    return Cost(side, ray, tail), per_row / _MANY


def straight(few: float, many: float, sides: int) -> tuple[float, float]:
    """Seconds of a side and of a ray, from those that 64 and 1024 rays of each of `sides` took.

    A line through both, that rises by no less than half of what a ray takes on the whole: trials of a few milliseconds
    on a busy machine may come out in the wrong order.
    """
    many = max(few, many, 1e-9)
    ray = max((many - few) / (_MANY - _FEW), many / _MANY / 2) / sides
    return max(few / sides - _FEW * ray, 0.0), ray


def _operator_cost(rows: list[OperatorRows], sources: int, settings: BakeSettings, values: int) -> tuple[float, float]:
    """Entries in a row of the trial, and seconds that an entry takes to gather and in all products."""
    begun = time.perf_counter()
    operator = StoredOperator(rows, sources)
    gathered = time.perf_counter() - begun
    dense = torch.zeros(sources, values)
    operator.product(dense)
    begun = time.perf_counter()
    operator.product(dense)
    product = time.perf_counter() - begun
    products = PRODUCTS if settings.bounces == CONVERGED else settings.bounces
    entries = max(operator.entries, 1)
    return entries / operator.receivers, (gathered + products * product) / entries
