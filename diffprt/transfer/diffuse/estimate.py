"""What a diffuse bake will cost, from a quick trial of a few receivers."""

from __future__ import annotations

import math
import time

import torch

from diffprt.options.bake import CONVERGED, OPERATORS, BakeSettings
from diffprt.surface.receivers import Receivers
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.estimate import RAY_BYTES, Estimate, fits
from diffprt.transfer.diffuse.convergence import direction_bytes
from diffprt.transfer.diffuse.direct import DirectTracer
from diffprt.transfer.diffuse.retrace import RAYS_PER_BLOCK

_PILOT_RAYS = 1 << 18
_LARGEST_PILOT_PATTERN = 4096
# Receivers that are traced one after the other in the trial, and about as many runs of them at least.
_RUN = 32
# Rough costs of a machine of today: seconds to store a chunk, products per second and thread of a sparse product.
_CHUNK_SECONDS = 0.004
_PRODUCTS_PER_SECOND = 2e9
# Bytes an entry of the operator takes while rows are gathered.
_ENTRY_BYTES = 16
# Products that a solve to convergence mostly takes.
PRODUCTS = 12


def estimate_diffuse(
    surfaces: Surfaces, receivers: Receivers, settings: BakeSettings, operator: str, threads: int
) -> Estimate:
    """Traces some receivers, a quarter of a million rays, and scales up; well under a second after compilation.

    Args:
        operator: "stored", "recompute", or "auto": stored where four fifths of the free memory hold it.
    """
    begun = time.perf_counter()
    mesh = surfaces.mesh(threads)
    structure_seconds = time.perf_counter() - begun
    pilot_rays = min(settings.rays, _LARGEST_PILOT_PATTERN)
    pilot = spread_receivers(receivers, max(_PILOT_RAYS // pilot_rays, 16))
    sides = Sides.of(pilot)
    pilot = pilot if sides is None else sides.traced
    bounce = settings.reflects
    pattern = surfaces.pattern(pilot, pilot_rays, settings.seed)
    corners = surfaces.source_of_corner.numpy() if bounce else None
    tracer = DirectTracer(mesh, pilot, pattern, settings.order, corners, len(surfaces.receivers))
    tracer.trace_rows(range(min(16, len(pilot))))
    trials = []
    for _ in range(2):
        begun = time.perf_counter()
        *_, rows = tracer.trace_rows(range(len(pilot)))
        trials.append(time.perf_counter() - begun)
    per_ray = min(trials) / (len(pilot) * pilot_rays)

    total_rays = receivers.sides * settings.rays
    hit_share = len(rows.columns) / 3 / (len(pilot) * pilot_rays) if rows is not None else 0.0
    entries = min(int(total_rays * hit_share * 3), receivers.sides * len(surfaces.receivers))
    memory = {name: diffuse_memory(surfaces, receivers, settings, entries, name, threads) for name in OPERATORS[1:]}
    if operator == "auto":
        operator = "stored" if fits(memory["stored"], 0.8) or not bounce else "recompute"
    products = PRODUCTS if settings.bounces == CONVERGED else settings.bounces
    traced = 1 + products * (operator == "recompute")
    chunk_rays = max(settings.rays, 1 << 18)
    seconds = structure_seconds + traced * total_rays * per_ray / threads
    seconds += math.ceil(total_rays / chunk_rays) * _CHUNK_SECONDS
    signal = _signal_bytes(surfaces, receivers, settings)
    seconds += products * entries * signal / len(receivers) / 4 / _PRODUCTS_PER_SECOND / threads
    return Estimate(
        receivers=len(receivers),
        rays=total_rays,
        seconds=seconds,
        memory_bytes=memory[operator],
        asset_bytes=signal + len(receivers) * 52 + len(surfaces.faces) * 12,
        operator_entries=entries,
        threads=threads,
        operator=operator,
    )


def diffuse_memory(
    surfaces: Surfaces, receivers: Receivers, settings: BakeSettings, entries: int, operator: str, threads: int
) -> int:
    """Peak bytes of a bake whose operator has `entries`."""
    signal = _signal_bytes(surfaces, receivers, settings)
    chunk_rays = max(settings.rays, 1 << 18)
    held = signal * 5 + len(surfaces.faces) * 150 + threads * chunk_rays * RAY_BYTES * (1 + settings.reflects)
    held += direction_bytes(signal) if settings.bounces == CONVERGED else 0
    at_a_time = entries if operator == "stored" else min(entries, 3 * max(RAYS_PER_BLOCK, chunk_rays))
    return held + at_a_time * _ENTRY_BYTES


def _signal_bytes(surfaces: Surfaces, receivers: Receivers, settings: BakeSettings) -> int:
    """Bytes of the signal."""
    channels = 3 if settings.reflects and surfaces.colored else 1
    return len(receivers) * channels * settings.order**2 * 4


def spread_receivers(receivers: Receivers, count: int) -> Receivers:
    """About `count` receivers, in runs of neighbors as a bake traces them, the runs evenly taken."""
    count = min(count, len(receivers))
    run = max(2, min(_RUN, count // _RUN))
    starts = torch.linspace(0, max(len(receivers) - run, 0), -(-count // run)).long()
    runs = (starts[:, None] + torch.arange(run)).reshape(-1).unique()
    pick = receivers.along_curve()[runs[runs < len(receivers)]]
    return receivers.picked(pick)
