"""What rays of a diffuse bake cost on this machine, as it is just now: measured, for a bake that has to end in time."""

from __future__ import annotations

import time
from collections.abc import Callable

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

# Rays of trials, and receivers that they begin with.
_FEW, _MANY = 64, 1024
_RECEIVERS, _PER_CHUNK = 1024, 64
# More rays of a receiver lie closer to each other and cost less each: trials go on until the rays that fit are within
# this factor of what was tried, with as many rays as this at a time.
_REACH, _TRIAL_RAYS = 1.5, 1 << 20
# Receivers of a trial at least, if they are no more than this part of all: some of them cost many times others.
_FEWEST, _SHARE = 256, 32
# The shortest of so many trials counts, or of as many as take this long.
_LEAST_TRIALS, _MOST_TRIALS, _LEAST_SECONDS = 2, 4, 0.1
# What the end of a bake takes for certain: writing, flushing to disk, leaving the interpreter.
_ENDING = 0.35
# Seconds for each value of the signal (certificate, openness, writing), and for each receiver (curve, patterns).
_VALUE, _RECEIVER = 4e-8, 1e-5


def measured_cost(
    surfaces: Surfaces,
    receivers: Receivers,
    settings: BakeSettings,
    threads: int,
    *,
    stored: bool,
    fit: Callable[[Cost], int],
) -> tuple[Cost, float]:
    """Traces some receivers with few and with many rays, on all threads, as the bake will.

    Args:
        receivers: all that will be traced.
        stored: whether the bounce operator is kept, or traced again for every product.
        fit: how many rays a bake of such a cost may take.

    Returns:
        the cost about the rays that fit, and the entries that a row of the bounce operator has for each ray.
    """
    trial = _Trial(surfaces, receivers, settings, threads)
    trial.seconds(_FEW)
    tried = {count: trial.seconds(count) for count in (_FEW, _MANY)}
    values = len(receivers) * (3 if settings.reflects and surfaces.colored else 1) * settings.order**2
    products = PRODUCTS if settings.bounces == CONVERGED else settings.bounces
    per_ray, per_entry = trial.operator_cost(_MANY, products, values // len(receivers))
    again = 0 if stored else products

    def cost() -> Cost:
        (few, less), (many, more) = sorted(tried.items())[-2:]
        side, ray = straight(few, less, many, more)

        def tail(rays: int) -> float:
            # Rays meet the same surfaces again and again, so that entries grow slower than rays: this errs on the safe
            # side where they are many.
            entries = receivers.sides * min(per_ray * rays, len(surfaces.receivers))
            fixed = _ENDING + _RECEIVER * len(receivers) + _VALUE * values
            return fixed + entries * per_entry + again * receivers.sides * (side + ray * rays)

        return Cost(side, ray, tail)

    while (rays := fit(cost())) > _REACH * max(tried):
        count = min(rays, 8 * max(tried))
        tried[count] = trial.seconds(count)
    return cost(), per_ray


class _Trial:
    """Some receivers, in runs of neighbors as a bake traces them."""

    def __init__(self, surfaces: Surfaces, receivers: Receivers, settings: BakeSettings, threads: int) -> None:
        self._surfaces, self._receivers, self._settings, self._threads = surfaces, receivers, settings, threads
        self._corners = surfaces.source_of_corner.numpy() if settings.reflects else None
        self._rows: list[OperatorRows] = []

    def seconds(self, rays: int) -> float:
        """Seconds of a side with so many rays, by the clock, on all threads."""
        count = max(_TRIAL_RAYS // rays, min(_FEWEST, len(self._receivers) // _SHARE))
        picked = spread_receivers(self._receivers, min(_RECEIVERS, max(count, 2 * self._threads)))
        sides = Sides.of(picked)
        picked = picked if sides is None else sides.traced
        surfaces, settings = self._surfaces, self._settings
        pattern = surfaces.pattern(picked, rays, settings.seed)
        sources = len(surfaces.receivers)
        tracer = DirectTracer(surfaces.mesh(), picked, pattern, settings.order, self._corners, sources)
        rows: dict[int, OperatorRows | None] = {}
        step = min(_PER_CHUNK, -(-len(picked) // (2 * self._threads)))

        def work(first: int) -> None:
            rows[first] = tracer.trace_rows(range(first, min(first + step, len(picked))))[2]

        times: list[float] = []
        # What else the machine does makes short trials longer, never shorter.
        while len(times) < _LEAST_TRIALS or (sum(times) < _LEAST_SECONDS and len(times) < _MOST_TRIALS):
            begun = time.perf_counter()
            for _ in run_chunks(work, range(0, len(picked), step), threads=self._threads):
                pass
            times.append(time.perf_counter() - begun)
            if times[-1] > _LEAST_SECONDS:
                break
        self._rows = [row for row in rows.values() if row is not None]
        return min(times) / len(picked)

    def operator_cost(self, rays: int, products: int, values: int) -> tuple[float, float]:
        """Of the last trace, with so many rays: entries in a row for each ray, and the seconds that an entry takes to
        gather and in all products."""
        if not self._rows:
            return 0.0, 0.0
        sources = len(self._surfaces.receivers)
        begun = time.perf_counter()
        operator = StoredOperator(self._rows, sources)
        gathered = time.perf_counter() - begun
        dense = torch.zeros(sources, values)
        operator.product(dense)
        begun = time.perf_counter()
        operator.product(dense)
        product = time.perf_counter() - begun
        entries = max(operator.entries, 1)
        return entries / operator.receivers / rays, (gathered + products * product) / entries


def straight(few: int, less: float, many: int, more: float) -> tuple[float, float]:
    """Seconds of a side and of each of its rays, from what a side took with `few` and with `many` rays.

    A line through both, that rises by no less than half of what a ray takes on the whole: trials of a few milliseconds
    on a busy machine may come out in the wrong order.
    """
    more = max(less, more, 1e-12)
    ray = max((more - less) / (many - few), more / many / 2)
    return max(less - few * ray, 0.0), ray
