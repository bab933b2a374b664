"""What a glossy bake will cost: memory from its sizes, time from a trial of a few receivers."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch

from diffprt.kernels import run_chunks
from diffprt.options.bake import GlossySettings
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.estimate import RAY_BYTES, Estimate
from diffprt.transfer.glossy.passes import RAYS_PER_CHUNK, RECEIVERS_PER_CHUNK, GlossyPasses
from diffprt.transfer.glossy.visibility_matrix import visibility_order

# Receivers that are traced in the trial.
_PILOT = 512


def estimate_glossy(
    surfaces: Surfaces, settings: GlossySettings, make_passes: Callable[[], GlossyPasses], threads: int
) -> Estimate:
    """Bakes some receivers and scales up; about a second after compilation, most of it for the BRDF's matrices."""
    count = len(surfaces.receivers)
    begun = time.perf_counter()
    with torch.no_grad():
        passes = make_passes()
        passes.ready(threads)
        materials = passes.materials
        fixed = time.perf_counter() - begun
        before = torch.zeros(1, *materials.shading.shape[1:4]).expand(count, -1, -1, -1)
        size = -(-min(_PILOT, count) // threads)
        starts = range((count - min(_PILOT, count)) // 2, (count + min(_PILOT, count)) // 2, size)

        def seconds_of(work: Callable[[range], object]) -> float:
            def part(first: int) -> None:
                with torch.no_grad():
                    work(range(first, min(first + size, count)))

            work(range(1))
            begun = time.perf_counter()
            for _ in run_chunks(part, starts, threads=threads):
                pass
            return time.perf_counter() - begun

        trial = seconds_of(passes.shadows)
        if settings.bounces:
            trial += settings.bounces * seconds_of(lambda rows: passes.bounce(rows, before))
    channels = materials.shading.shape[1]
    return Estimate(
        receivers=count,
        rays=count * (settings.rays + settings.bounces * settings.bounce_rays),
        seconds=fixed + trial * count / min(_PILOT, count),
        memory_bytes=glossy_memory(surfaces, channels, settings, threads),
        asset_bytes=signal_bytes(count, channels, settings) + count * 36 + len(surfaces.receivers.faces) * 12,
        threads=threads,
    )


def signal_bytes(receivers: int, channels: int, settings: GlossySettings) -> int:
    """Bytes of the signal [V, C, K_out, K] in float32."""
    return receivers * channels * settings.order_out**2 * settings.order**2 * 4


def glossy_memory(surfaces: Surfaces, channels: int, settings: GlossySettings, threads: int) -> int:
    """Peak bytes of a glossy bake: signals before and after a pass, triangles, and what the threads work on."""
    count = len(surfaces.receivers)
    signal = signal_bytes(count, channels, settings)
    bands = visibility_order(settings.order_out, settings.order)
    rows_at_once = min(count, RECEIVERS_PER_CHUNK, max(1, RAYS_PER_CHUNK // settings.rays))
    turned = 8 * (4 * bands - 2 + 2 * bands) * bands**2
    matrices = 8 * 4 * channels * settings.order_out**2 * settings.order**2
    at_once = rows_at_once * (turned + matrices)
    if settings.bounces:
        rows_at_once = min(count, RECEIVERS_PER_CHUNK, max(1, RAYS_PER_CHUNK // settings.bounce_rays))
        rows = 4 * channels * (3 * settings.order_out**2 + 2 * settings.order**2)
        at_once = max(at_once, rows_at_once * settings.bounce_rays * (RAY_BYTES + rows))
    return signal * (3 if settings.bounces else 2) + len(surfaces.faces) * 150 + threads * at_once
