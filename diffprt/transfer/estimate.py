"""What a bake will cost, from a quick trial of a few receivers."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass

import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.scene import Scene
from diffprt.transfer.direct import DirectTracer
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.sampling import Pattern
from diffprt.transfer.settings import BakeSettings
from diffprt.transfer.surfaces import Surfaces

_PILOT_RAYS = 1 << 18
_LARGEST_PILOT_PATTERN = 4096
# Rough costs of a machine of today: seconds to store a chunk, products per second and thread of a sparse product.
_CHUNK_SECONDS = 0.004
_PRODUCTS_PER_SECOND = 2e9
# Bytes a ray in flight takes: its hit, and the sort that gathers hits by the vertex that reflects.
_RAY_BYTES = 200


@dataclass(frozen=True)
class Estimate:
    """Expected cost of a bake.

    Attributes:
        receivers, rays: counts; rays over all receivers.
        seconds: wall clock on `threads` threads, without installation and kernel compilation.
        memory_bytes: peak beyond the interpreter and its libraries.
        asset_bytes: size of the saved signal and geometry.
        operator_entries: stored entries of the bounce operator.
        threads: CPU threads.
    """

    receivers: int
    rays: int
    seconds: float
    memory_bytes: int
    asset_bytes: int
    operator_entries: int
    threads: int

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)


def estimate_bake(scene: Scene, settings: BakeSettings, *, threads: int | None = None) -> Estimate:
    """Traces some receivers, a quarter of a million rays, and scales up; well under a second after compilation."""
    threads = threads or default_threads()
    surfaces = Surfaces.of(scene)
    receivers = surfaces.receivers
    begun = time.perf_counter()
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    structure_seconds = time.perf_counter() - begun
    pilot_rays = min(settings.rays, _LARGEST_PILOT_PATTERN)
    pilot = _spread(receivers, max(_PILOT_RAYS // pilot_rays, 16))
    bounce = settings.bounces > 0
    pattern = Pattern.create(pilot_rays, pilot.scramble(settings.seed, surfaces.positions.amin(0), surfaces.diagonal))
    corners = surfaces.source_of_corner.numpy() if bounce else None
    tracer = DirectTracer(mesh, pilot, pattern, settings.order, corners, len(receivers))
    tracer.trace_rows(range(min(16, len(pilot))))
    trials = []
    for _ in range(2):
        begun = time.perf_counter()
        *_, rows = tracer.trace_rows(range(len(pilot)))
        trials.append(time.perf_counter() - begun)
    per_ray = min(trials) / (len(pilot) * pilot_rays)

    total_rays = len(receivers) * settings.rays
    coefficients = settings.order**2
    channels = 3 if bounce and surfaces.colored else 1
    hit_share = len(rows.columns) / 3 / (len(pilot) * pilot_rays) if rows is not None else 0.0
    entries = min(int(total_rays * hit_share * 3), len(receivers) ** 2)
    signal = len(receivers) * channels * coefficients * 4
    chunk_rays = max(settings.rays, 1 << 18)
    chunks = math.ceil(total_rays / chunk_rays)
    in_flight = threads * chunk_rays * _RAY_BYTES * (1 + bounce)
    seconds = structure_seconds + total_rays * per_ray / threads + chunks * _CHUNK_SECONDS
    seconds += settings.bounces * entries * channels * coefficients / _PRODUCTS_PER_SECOND / threads
    return Estimate(
        receivers=len(receivers),
        rays=total_rays,
        seconds=seconds,
        memory_bytes=entries * 16 + signal * 5 + len(surfaces.faces) * 150 + in_flight,
        asset_bytes=signal + len(receivers) * 36 + len(surfaces.faces) * 12,
        operator_entries=entries,
        threads=threads,
    )


def check_memory(estimate: Estimate, settings: BakeSettings, available: int) -> None:
    """Refuses a bake that would not fit into `available` bytes, before hours are spent on it."""
    if estimate.memory_bytes > available:
        remedy = "fewer --rays, a coarser mesh" + (", or --bounces 0" if settings.bounces else "")
        raise InputError(
            f"this bake needs about {estimate.memory_bytes / 2**30:.1f} GiB and {available / 2**30:.1f} GiB are free: "
            f"use {remedy}"
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
    """At most `count` receivers, evenly taken."""
    pick = torch.linspace(0, len(receivers) - 1, min(count, len(receivers))).round().long().unique()
    return Receivers(
        receivers.positions[pick],
        receivers.normals[pick],
        receivers.albedo[pick],
        torch.zeros((0, 3), dtype=torch.int64),
    )
