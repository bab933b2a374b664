"""Baking glossy transfer: the shadow pass, then passes of light transport."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial

import torch

from diffprt.brdf import Brdf, describe_brdf
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads, run_chunks
from diffprt.scene import Scene
from diffprt.transfer.estimate import available_memory
from diffprt.transfer.glossy_estimate import (
    RAYS_PER_CHUNK,
    RECEIVERS_PER_CHUNK,
    check_glossy_memory,
    glossy_memory,
)
from diffprt.transfer.glossy_materials import GlossyMaterials
from diffprt.transfer.glossy_passes import GlossyPasses
from diffprt.transfer.glossy_settings import GlossySettings
from diffprt.transfer.glossy_signal import GlossyTransfer
from diffprt.transfer.surfaces import Surfaces
from diffprt.transfer.transport import Interrupted, Track, timed, untracked


def bake_glossy(
    scene: Scene,
    brdf: Brdf | Sequence[Brdf],
    *,
    order: int = 6,
    order_out: int | None = None,
    rays: int = 1024,
    bounces: int = 1,
    bounce_rays: int | None = None,
    ridge: float = 3e-4,
    seed: int = 0,
    threads: int | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> GlossyTransfer:
    """Computes glossy transfer at the scene's own vertices.

    Shadows are exact in the light's bands up to the sampling of visibility: see `transfer.visibility_matrix`. The
    albedo of the scene's materials plays no part; `brdf` alone reflects.

    Args:
        scene: what occludes and reflects.
        brdf: one for the whole scene, or one per material.
        order: SH bands of incident light, 1 to 10.
        order_out: SH bands of exit radiance, 1 to 10; `order` without it.
        rays: rays per receiver over its upper hemisphere that sample visibility.
        bounces: interreflections.
        bounce_rays: rays per receiver that gather each bounce; a quarter of `rays`, but at least 256, without it.
        ridge: smoothing of exit radiance below the surface; see `diffprt.brdf.fit`.
        seed: the same seed gives the same bytes for any number of threads.
        threads: CPU threads; all that the process may use without it.
        track: `track(text, total, done)`, a context manager that yields what to call after each chunk.
        report: filled with timings, counts, errors and settings.

    Returns:
        `GlossyTransfer`, float32. Gradients reach the parameters of the BRDFs; visibility is frozen. With bounces,
        the memory for gradients grows with the rays that hit something.

    Raises:
        InputError: an option is out of range, another number of BRDFs than materials, or a signal beyond memory.
        Interrupted: Ctrl-C; nothing is kept.
    """
    settings = GlossySettings(order, rays, bounces, seed, order_out, bounce_rays, ridge)
    if threads is not None and threads < 1:
        raise InputError(f"threads is {threads}: give 1 or more, or leave it out to use all {default_threads()}")
    threads = threads or default_threads()
    surfaces = Surfaces.of(scene)
    brdfs = [brdf] if isinstance(brdf, Brdf) else list(brdf)
    channels = max((b.channels for b in brdfs), default=1)
    check_glossy_memory(glossy_memory(surfaces, channels, settings, threads), available_memory(), settings)
    report = {} if report is None else report
    report |= {"timings": {}, "counts": {}}
    timings = report["timings"]
    with timed(timings, "total"):
        with timed(timings, "BRDF matrices"):
            materials = GlossyMaterials.of(scene, brdf, settings.order, settings.order_out, settings.ridge)
        with timed(timings, "acceleration structure"):
            mesh = TriangleMesh(surfaces.positions, surfaces.faces, threads=threads)
        passes = GlossyPasses(surfaces, mesh, materials, settings)
        gradients = torch.is_grad_enabled() and materials.reflection.requires_grad
        signal, certificate = _run(passes, materials, settings, gradients, threads, track, timings)
    saved = {**settings.as_dict(), "brdf": [describe_brdf(b) for b in brdfs]}
    transfer = GlossyTransfer(signal, surfaces.receivers, saved, {}, certificate, scene.hash())
    per_receiver = settings.rays + settings.bounces * settings.bounce_rays
    report["errors"], report["settings"] = certificate, transfer.settings
    report["counts"] |= {
        "threads": threads,
        "triangles": len(surfaces.faces),
        "receivers": len(surfaces.receivers),
        "rays": len(surfaces.receivers) * per_receiver,
        "bounces": settings.bounces,
        "channels": transfer.channels,
        "bytes": transfer.nbytes,
    }
    return transfer


def _run(
    passes: GlossyPasses,
    materials: GlossyMaterials,
    settings: GlossySettings,
    gradients: bool,
    threads: int,
    track: Track,
    timings: dict[str, float],
) -> tuple[torch.Tensor, dict]:
    """All passes: transfer in the receivers' own order, and its certificate."""
    count = len(passes.order)
    shape = (count, *materials.shading.shape[1:4])
    chunked = partial(_chunked, shape=shape, gradients=gradients, threads=threads, track=track)
    squares: dict[int, torch.Tensor] = {}

    def shadows(rows: range) -> torch.Tensor:
        signal, squares[rows.start] = passes.shadows(rows)
        return signal

    with timed(timings, "shadow pass"):
        direct = chunked(shadows, rays=settings.rays, text="shadows")
    transfer = direct
    with timed(timings, "light transport"):
        for number in range(1, settings.bounces + 1):

            def bounce(rows: range, before: torch.Tensor = transfer) -> torch.Tensor:
                return direct[rows.start : rows.stop] + passes.bounce(rows, before)

            transfer = chunked(bounce, rays=settings.bounce_rays, text=f"bounce {number} of {settings.bounces}")
            del bounce
    # Summed in the order of the receivers, so that the certificate too has the same bytes for any number of threads.
    total = torch.stack([squares[first] for first in sorted(squares)]).sum(0)
    noise, size = (total / count).sqrt().tolist()
    certificate = {"noise_rms": noise, "signal_rms": size, "noise_relative": noise / size if size > 0 else 0.0}
    place = torch.empty_like(passes.order)
    place[passes.order] = torch.arange(count)
    return transfer[place], certificate


def _chunked(
    work: Callable[[range], torch.Tensor],
    shape: tuple[int, ...],
    rays: int,
    *,
    gradients: bool,
    threads: int,
    track: Track,
    text: str,
) -> torch.Tensor:
    """Results of `work` on runs of receivers, joined to float32 `shape`; the cut does not depend on the threads."""
    size = max(1, min(RECEIVERS_PER_CHUNK, RAYS_PER_CHUNK // rays))
    chunks = [range(first, min(first + size, shape[0])) for first in range(0, shape[0], size)]
    parts: list[torch.Tensor] = [torch.empty(0)] * len(chunks)
    whole = torch.empty(0 if gradients else shape)
    ended = 0

    def one(number: int) -> None:
        # Threads begin with gradients enabled, whatever their parent has.
        with torch.set_grad_enabled(gradients):
            part = work(chunks[number])
        if gradients:
            parts[number] = part
        else:
            whole[chunks[number].start : chunks[number].stop] = part

    with (
        track(text, len(chunks), 0) as advance,
        closing(run_chunks(one, range(len(chunks)), threads=threads)) as running,
    ):
        try:
            for _ in running:
                ended += 1
                advance()
        except KeyboardInterrupt:
            running.close()
            raise Interrupted(
                f"interrupted: {ended} of {len(chunks)} chunks of {text} were done, and nothing is kept: "
                "repeat the command to start anew"
            ) from None
    return torch.cat(parts) if gradients else whole
