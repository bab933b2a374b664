"""What a bake will cost, from a quick trial of a few receivers."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass

import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.options.bake import CONVERGED, OPERATORS, BakeSettings
from diffprt.scene import Scene
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.convergence import direction_bytes
from diffprt.transfer.diffuse.direct import DirectTracer
from diffprt.transfer.diffuse.retrace import RAYS_PER_BLOCK

_PILOT_RAYS = 1 << 18
_LARGEST_PILOT_PATTERN = 4096
# Receivers that are traced one after the other in the trial.
_RUN = 32
# Rough costs of a machine of today: seconds to store a chunk, products per second and thread of a sparse product.
_CHUNK_SECONDS = 0.004
_PRODUCTS_PER_SECOND = 2e9
# Bytes a ray in flight takes: its hit, and the sort that gathers hits by the vertex that reflects.
_RAY_BYTES = 200
# Bytes an entry of the operator takes while rows are gathered.
_ENTRY_BYTES = 16
# Products that a solve to convergence mostly takes.
_PRODUCTS = 12
# A bake of fewer rays takes minutes at most: it is not estimated.
_FEW_RAYS = 1 << 28


@dataclass(frozen=True)
class Estimate:
    """Expected cost of a bake.

    Attributes:
        receivers, rays: counts; rays over all receivers.
        seconds: wall clock on `threads` threads, without installation and kernel compilation.
        memory_bytes: peak beyond the interpreter and its libraries.
        asset_bytes: size of the saved signal and geometry.
        operator_entries: entries of the bounce operator.
        threads: CPU threads.
        operator: "stored", or "recompute" where it is traced again for every product.
    """

    receivers: int
    rays: int
    seconds: float
    memory_bytes: int
    asset_bytes: int
    operator_entries: int
    threads: int
    operator: str

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)


def estimate_bake(
    scene: Scene,
    settings: BakeSettings,
    *,
    receivers: Receivers | None = None,
    operator: str = "auto",
    threads: int | None = None,
) -> Estimate:
    """Traces some receivers, a quarter of a million rays, and scales up; well under a second after compilation.

    Args:
        receivers: as in `bake`.
        operator: "stored", "recompute", or "auto": stored where four fifths of the free memory hold it.
    """
    threads = threads or default_threads()
    surfaces = Surfaces.of(scene)
    receivers = surfaces.receivers if receivers is None else receivers
    begun = time.perf_counter()
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    structure_seconds = time.perf_counter() - begun
    pilot_rays = min(settings.rays, _LARGEST_PILOT_PATTERN)
    pilot = _spread(receivers, max(_PILOT_RAYS // pilot_rays, 16))
    sides = Sides.of(pilot)
    pilot = pilot if sides is None else sides.traced
    bounce = settings.reflects
    pattern = Pattern.create(pilot_rays, pilot.scramble(settings.seed, surfaces.positions.amin(0), surfaces.diagonal))
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
    memory = {name: _memory(surfaces, receivers, settings, entries, name, threads) for name in OPERATORS[1:]}
    if operator == "auto":
        operator = "stored" if memory["stored"] <= 0.8 * available_memory() or not bounce else "recompute"
    products = _PRODUCTS if settings.bounces == CONVERGED else settings.bounces
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


def choose_operator(
    scene: Scene, settings: BakeSettings, receivers: Receivers, operator: str, *, hours: float, threads: int
) -> str:
    """ "stored" or "recompute", for a bake that fits into memory and into `hours`.

    Small bakes are not estimated: they take minutes and surely fit.

    Raises:
        InputError: the bake does not fit.
    """
    surfaces = Surfaces.of(scene)
    rays = receivers.sides * settings.rays
    most = min(3 * rays, receivers.sides * len(surfaces.receivers)) if settings.reflects else 0
    available = available_memory()
    kind = "stored" if operator == "auto" else operator
    if rays <= _FEW_RAYS and _memory(surfaces, receivers, settings, most, kind, threads) <= available / 2:
        return kind
    estimate = estimate_bake(scene, settings, receivers=receivers, operator=operator, threads=threads)
    check_memory(estimate, settings, available)
    check_time(estimate, hours)
    return estimate.operator


def _memory(
    surfaces: Surfaces, receivers: Receivers, settings: BakeSettings, entries: int, operator: str, threads: int
) -> int:
    """Peak bytes of a bake whose operator has `entries`."""
    signal = _signal_bytes(surfaces, receivers, settings)
    chunk_rays = max(settings.rays, 1 << 18)
    held = signal * 5 + len(surfaces.faces) * 150 + threads * chunk_rays * _RAY_BYTES * (1 + settings.reflects)
    held += direction_bytes(signal) if settings.bounces == CONVERGED else 0
    at_a_time = entries if operator == "stored" else min(entries, 3 * max(RAYS_PER_BLOCK, chunk_rays))
    return held + at_a_time * _ENTRY_BYTES


def _signal_bytes(surfaces: Surfaces, receivers: Receivers, settings: BakeSettings) -> int:
    """Bytes of the signal."""
    channels = 3 if settings.reflects and surfaces.colored else 1
    return len(receivers) * channels * settings.order**2 * 4


def check_memory(estimate: Estimate, settings: BakeSettings, available: int) -> None:
    """Refuses a bake that would not fit into `available` bytes, before hours are spent on it."""
    if estimate.memory_bytes > available:
        remedies = ["fewer --rays", "a coarser mesh"]
        if settings.reflects:
            remedies += ["--operator recompute"] if estimate.operator == "stored" else ["--bounces 0"]
        raise InputError(
            f"this bake needs about {estimate.memory_bytes / 2**30:.1f} GiB and {available / 2**30:.1f} GiB are free: "
            f"use {', '.join(remedies[:-1])} or {remedies[-1]}"
        )


def check_time(estimate: Estimate, hours: float) -> None:
    """Refuses a bake that is expected to take more than `hours`."""
    needed = estimate.seconds / 3600
    if needed > hours:
        raise InputError(
            f"this bake of {estimate.rays:.3g} rays takes about {needed:.1f} hours on {estimate.threads} threads, and "
            f"hours is {hours:g}: bound it with --seconds or fewer --rays, or allow it with --hours {math.ceil(needed)}"
        )


def available_memory() -> int:
    """Free memory of this machine [bytes]; unlimited where it cannot be told."""
    try:
        with open("/proc/meminfo") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 1 << 62


def _spread(receivers: Receivers, count: int) -> Receivers:
    """About `count` receivers, in runs of neighbors as a bake traces them, the runs evenly taken."""
    count = min(count, len(receivers))
    starts = torch.linspace(0, max(len(receivers) - _RUN, 0), -(-count // _RUN)).long()
    runs = (starts[:, None] + torch.arange(_RUN)).reshape(-1).unique()
    pick = receivers.along_curve()[runs[runs < len(receivers)]]
    return receivers.picked(pick)
