"""Baking glossy transfer: the shadow pass, then passes of light transport."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import torch

from diffprt import sh
from diffprt.brdf import Brdf, hemisphere_gram
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads, run_chunks
from diffprt.scene import Scene
from diffprt.sh.frames import frame_rotations, rows_from_frames
from diffprt.transfer.glossy_bounce import GlossyBouncer
from diffprt.transfer.glossy_materials import GlossyMaterials
from diffprt.transfer.glossy_signal import GlossyTransfer
from diffprt.transfer.sampling import Pattern, tangent_frames
from diffprt.transfer.settings import BakeSettings
from diffprt.transfer.surfaces import Surfaces
from diffprt.transfer.transport import Track, timed, untracked
from diffprt.transfer.visibility_matrix import VisibilityTracer, visibility_order

_RAYS_PER_CHUNK = 1 << 19
_RECEIVERS_PER_CHUNK = 1024


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
        order: SH bands of incident light.
        order_out: SH bands of exit radiance; `order` without it.
        rays: rays per receiver over its upper hemisphere that sample visibility.
        bounces: interreflections.
        bounce_rays: rays per receiver that gather each bounce; a quarter of `rays`, but at least 256, without it.
        ridge: smoothing of exit radiance below the surface; see `diffprt.brdf.fit`.
        seed: the same seed gives the same bytes for any number of threads.
        threads: CPU threads; all that the process may use without it.
        track: `track(text, total, done)`, a context manager that yields what to call after each chunk.
        report: filled with timings, counts and errors.

    Returns:
        `GlossyTransfer`, float32. Gradients reach the parameters of the BRDFs; visibility is frozen. With bounces,
        the memory for gradients grows with the rays that hit something.

    Raises:
        InputError: an option is out of range, or another number of BRDFs than materials.
    """
    if isinstance(bounces, str):
        raise InputError(f"bounces is '{bounces}': glossy transfer takes a number, 0 to 64, such as 2")
    settings = BakeSettings(order=order, rays=rays, bounces=bounces, seed=seed)
    order_out = sh.check_order(order if order_out is None else order_out)
    bounce_rays = max(256, rays // 4) if bounce_rays is None else bounce_rays
    if not 1 <= bounce_rays <= 1 << 20:
        raise InputError(f"bounce_rays is {bounce_rays}: give 1 to 1048576 rays per receiver, such as 256")
    threads = threads or default_threads()
    report = {} if report is None else report
    report |= {"timings": {}, "counts": {}}
    timings = report["timings"]
    with timed(timings, "BRDF matrices"):
        materials = GlossyMaterials.of(scene, brdf, order, order_out, ridge)
    surfaces = Surfaces.of(scene)
    receivers = surfaces.receivers
    scramble = receivers.scramble(seed, surfaces.positions.amin(0), surfaces.diagonal)
    with timed(timings, "acceleration structure"):
        mesh = TriangleMesh(surfaces.positions, surfaces.faces, threads=threads)
    frames = tangent_frames(receivers.normals.double())
    bands = visibility_order(order_out, order)
    tracer = VisibilityTracer(mesh, receivers, Pattern.create(rays, scramble), bands)

    exit_weight = hemisphere_gram(order_out, cosine=True)
    squares: dict[int, torch.Tensor] = {}

    def shadows(rows: range) -> torch.Tensor:
        rotations = frame_rotations(frames[rows.start : rows.stop], bands)
        index = materials.of_receiver[rows.start : rows.stop]
        visibility, error = tracer.trace(rows, rotations)
        local = materials.shade(visibility, index)
        both = materials.shade(error, index).detach(), local.detach()
        squares[rows.start] = torch.stack([(t * (exit_weight @ t)).sum() for t in both])
        return rows_from_frames(local.flatten(1, 2), rotations[:order]).unflatten(1, local.shape[1:3]).float()

    chunked = partial(
        _chunked,
        shape=(len(receivers), *materials.shading.shape[1:4]),
        gradients=torch.is_grad_enabled() and materials.reflection.requires_grad,
        threads=threads,
        track=track,
    )
    with timed(timings, "shadow pass"):
        direct = chunked(shadows, rays=rays, text="shadows")
    transfer = direct
    if bounces:
        pattern = Pattern.create(bounce_rays, scramble)
        bouncer = GlossyBouncer(mesh, receivers, surfaces.source_of_corner, pattern, materials)
        with timed(timings, "light transport"):
            for number in range(1, bounces + 1):
                before = transfer

                def bounce(rows: range, before: torch.Tensor = before) -> torch.Tensor:
                    return direct[rows.start : rows.stop] + bouncer.gather(rows, before)

                transfer = chunked(bounce, rays=bounce_rays, text=f"bounce {number}")
    # In the order of the receivers, so that the certificate too has the same bytes for any number of threads.
    total = torch.stack([squares[first] for first in sorted(squares)]).sum(0)
    noise, size = (total / len(receivers)).sqrt().tolist()
    certificate = {"noise_rms": noise, "signal_rms": size, "noise_relative": noise / size if size > 0 else 0.0}
    report["errors"] = certificate
    report["counts"] |= {"threads": threads, "triangles": len(surfaces.faces), "receivers": len(receivers)}
    options = {"order_out": order_out, "bounce_rays": bounce_rays, "ridge": ridge, "brdf": _names(brdf)}
    return GlossyTransfer(transfer, receivers, {**settings.as_dict(), **options}, {}, certificate, scene.hash())


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
    size = max(1, min(_RECEIVERS_PER_CHUNK, _RAYS_PER_CHUNK // rays))
    chunks = [range(first, min(first + size, shape[0])) for first in range(0, shape[0], size)]
    parts: list[torch.Tensor] = [torch.empty(0)] * len(chunks)
    whole = torch.empty(0 if gradients else shape)

    def one(number: int) -> None:
        # Threads begin with gradients enabled, whatever their parent has.
        with torch.set_grad_enabled(gradients):
            part = work(chunks[number])
        if gradients:
            parts[number] = part
        else:
            whole[chunks[number].start : chunks[number].stop] = part

    with track(text, len(chunks), 0) as advance:
        for _ in run_chunks(one, range(len(chunks)), threads=threads):
            advance()
    return torch.cat(parts) if gradients else whole


def _names(brdf: Brdf | Sequence[Brdf]) -> list[str]:
    return [repr(b) for b in ([brdf] if isinstance(brdf, Brdf) else brdf)]
