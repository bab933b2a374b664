"""What a glossy bake will cost: memory from its sizes, time from a trial of a few receivers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import torch

from diffprt.brdf import Brdf
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads, run_chunks
from diffprt.options.bake import GlossySettings
from diffprt.scene import Scene
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.passes import GlossyPasses
from diffprt.transfer.glossy.visibility_matrix import visibility_order

RAYS_PER_CHUNK = 1 << 19
RECEIVERS_PER_CHUNK = 1024
# Receivers that are traced in the trial.
_PILOT = 512
# Bytes that a ray in flight takes beside its rows: its hit and the sorts that group hits.
_RAY_BYTES = 200
_GIB = 2**30


@dataclass(frozen=True)
class GlossyEstimate:
    """Expected cost of a glossy bake.

    Attributes:
        receivers, rays: counts; rays over all receivers and passes.
        seconds: wall clock on `threads` threads, without kernel compilation.
        memory_bytes: peak beyond the interpreter and its libraries.
        asset_bytes: size of the saved signal and geometry.
        threads: CPU threads.
    """

    receivers: int
    rays: int
    seconds: float
    memory_bytes: int
    asset_bytes: int
    threads: int

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)


def estimate_glossy(
    scene: Scene, brdf: Brdf | Sequence[Brdf], settings: GlossySettings, *, threads: int | None = None
) -> GlossyEstimate:
    """Bakes some receivers and scales up; about a second after compilation, most of it for the BRDF's matrices.

    Raises:
        InputError: another number of BRDFs than materials.
    """
    threads = threads or default_threads()
    scene = scene.with_brdf(brdf)
    surfaces = Surfaces.of(scene)
    count = len(surfaces.receivers)
    begun = time.perf_counter()
    with torch.no_grad():
        materials = GlossyMaterials.of(scene, settings.order, settings.order_out, settings.ridge)
        mesh = TriangleMesh(surfaces.positions, surfaces.faces, threads=threads)
        passes = GlossyPasses(surfaces, mesh, materials, settings)
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
    return GlossyEstimate(
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
        at_once = max(at_once, rows_at_once * settings.bounce_rays * (_RAY_BYTES + rows))
    return signal * (3 if settings.bounces else 2) + len(surfaces.faces) * 150 + threads * at_once


def check_glossy_memory(needed: int, available: int, settings: GlossySettings) -> None:
    """Refuses a bake that would not fit into `available` bytes, before any work.

    Raises:
        InputError: it does not fit.
    """
    if needed > available:
        raise InputError(
            f"this glossy bake needs about {needed / _GIB:.2f} GiB and {available / _GIB:.2f} GiB are free: use a "
            f"lower --order (now {settings.order}) or --order-out (now {settings.order_out}), or a coarser mesh"
        )


def check_glossy_time(estimate: GlossyEstimate, hours: float) -> None:
    """Refuses a bake that is expected to take more than `hours`.

    Raises:
        InputError: it is.
    """
    needed = estimate.seconds / 3600
    if needed > hours:
        raise InputError(
            f"this glossy bake of {estimate.rays:.3g} rays takes about {needed:.1f} hours on {estimate.threads} "
            f"threads, and hours is {hours:g}: use fewer --rays or --bounces, or allow it with --hours "
            f"{math.ceil(needed)}"
        )
