"""Baking glossy transfer: the shadow pass, then passes of light transport."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from diffprt.brdf import Brdf, describe_brdf
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.options.bake import GlossySettings
from diffprt.progress import Track, timed, untracked
from diffprt.representation.provenance import Provenance
from diffprt.scene import Scene
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.estimate import available_memory
from diffprt.transfer.baking.glossy_chunks import ChunkedPasses
from diffprt.transfer.baking.glossy_estimate import check_glossy_memory, glossy_memory
from diffprt.transfer.glossy.materials import GlossyMaterials, brdfs_of
from diffprt.transfer.glossy.passes import GlossyPasses
from diffprt.transfer.glossy.signal import GlossyTransfer


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
    checkpoint: str | Path | None = None,
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
        checkpoint: folder for finished chunks, as large as the signal for each pass. A bake that was killed goes on
            from there to the same bytes. It stays when the bake ends: `discard_chunks` it once the asset is saved.
        track: `track(text, total, done)`, a context manager that yields what to call after each chunk.
        report: filled with timings, counts, errors and settings.

    Returns:
        `GlossyTransfer`, float32. Gradients reach the parameters of the BRDFs; visibility is frozen. With bounces,
        the memory for gradients grows with the rays that hit something.

    Raises:
        InputError: an option is out of range, another number of BRDFs than materials, a signal beyond memory, or a
            checkpoint of another bake or of one with gradients.
        Interrupted: Ctrl-C; with a checkpoint nothing finished is lost.
    """
    settings = GlossySettings(order, rays, bounces, seed, order_out, bounce_rays, ridge)
    if threads is not None and threads < 1:
        raise InputError(f"threads is {threads}: give 1 or more, or leave it out to use all {default_threads()}")
    threads = threads or default_threads()
    surfaces = Surfaces.of(scene)
    scene = scene.with_brdf(brdf)
    brdfs = brdfs_of(scene)
    channels = max(b.channels for b in brdfs)
    check_glossy_memory(glossy_memory(surfaces, channels, settings, threads), available_memory(), settings)
    saved = {**settings.as_dict(), "brdf": [describe_brdf(b) for b in brdfs]}
    scene_hash = scene.hash()
    report = {} if report is None else report
    report |= {"timings": {}, "counts": {}}
    timings = report["timings"]
    with timed(timings, "total"):
        with timed(timings, "BRDF matrices"):
            materials = GlossyMaterials.of(scene, settings.order, settings.order_out, settings.ridge)
        with timed(timings, "acceleration structure"):
            mesh = TriangleMesh(surfaces.positions, surfaces.faces, threads=threads)
        passes = GlossyPasses(surfaces, mesh, materials, settings)
        gradients = torch.is_grad_enabled() and materials.reflection.requires_grad
        folder = None if checkpoint is None else Path(checkpoint)
        if gradients and folder is not None:
            raise InputError(
                f"checkpoint is {folder}, and the BRDF asks for gradients, which files do not keep: give one of them"
            )
        shape = (len(passes.order), *materials.shading.shape[1:4])
        key = {**saved, "scene": scene_hash}
        chunked = ChunkedPasses(shape, settings, key, folder, gradients=gradients, threads=threads, track=track)
        report["counts"] |= chunked.counts
        signal, certificate = _run(passes, settings, chunked, timings)
    transfer = GlossyTransfer(signal, surfaces.receivers, Provenance(saved, {}, certificate, scene_hash))
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
    passes: GlossyPasses, settings: GlossySettings, chunked: ChunkedPasses, timings: dict[str, float]
) -> tuple[torch.Tensor, dict]:
    """All passes: transfer in the receivers' own order, and its certificate."""

    def shadows(rows: range) -> dict[str, torch.Tensor]:
        signal, squares = passes.shadows(rows)
        return {"signal": signal, "squares": squares}

    with timed(timings, "shadow pass"):
        direct, kept = chunked.run(0, shadows, "shadows")
    transfer = direct
    with timed(timings, "light transport"):
        for number in range(1, settings.bounces + 1):

            def bounce(rows: range, before: torch.Tensor = transfer) -> dict[str, torch.Tensor]:
                return {"signal": direct[rows.start : rows.stop] + passes.bounce(rows, before)}

            transfer, _ = chunked.run(number, bounce, f"bounce {number} of {settings.bounces}")
            del bounce
    count = len(passes.order)
    # Summed in the order of the receivers, so that the certificate too has the same bytes for any number of threads.
    noise, size = (torch.stack([chunk["squares"] for chunk in kept]).sum(0) / count).sqrt().tolist()
    certificate = {"noise_rms": noise, "signal_rms": size, "noise_relative": noise / size if size > 0 else 0.0}
    return transfer[passes.order.argsort()], certificate
