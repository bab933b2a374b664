"""Baking: from a scene to the transfer of its receivers."""

from __future__ import annotations

from pathlib import Path

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.scene import Scene
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.settings import BakeSettings
from diffprt.transfer.signal import Transfer
from diffprt.transfer.surfaces import Surfaces
from diffprt.transfer.transport import Track, Transport, timed, trace_transport, untracked


def bake(
    scene: Scene,
    *,
    receivers: Receivers | None = None,
    quality: str = "good",
    order: int | None = None,
    rays: int | None = None,
    bounces: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    checkpoint: str | Path | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> Transfer:
    """Computes diffuse transfer: shadows, then interreflection, in SH (Sloan, Kautz and Snyder 2002).

    Args:
        scene: what occludes and reflects.
        receivers: where transfer is wanted; without it, at the vertices of every mesh that is not occluder-only.
        quality: "draft", "good" or "best": defaults of the next three.
        order: SH bands, 1 to 10.
        rays: rays per receiver over its upper hemisphere, cosine-distributed.
        bounces: diffuse interreflections.
        seed: the same seed gives the same bytes for any number of threads.
        threads: CPU threads; all that the process may use without it.
        checkpoint: folder for finished chunks. A bake that was killed goes on from there to the same bytes. It
            stays when the bake ends: `discard_chunks` it once the asset is saved.
        track: `track(text, total, done)`, a context manager that yields what to call after each chunk.
        report: filled with timings, counts and errors.

    Returns:
        `Transfer` with its settings and certificate. Gradients reach the scene's albedo through the bounces, if
        it asks for them; visibility is frozen. `trace` gives the form for many albedos.

    Raises:
        InputError: an option is out of range.
        Interrupted: Ctrl-C; with a checkpoint nothing finished is lost.
    """
    settings = BakeSettings.of(quality, order=order, rays=rays, bounces=bounces, seed=seed)
    report = {} if report is None else report
    report |= {"settings": settings.as_dict(), "timings": {}, "counts": {}}
    folder = Path(checkpoint) if checkpoint is not None else None
    with timed(report["timings"], "total"):
        if receivers is None:
            transport = _trace(scene, settings, None, threads, folder, track, report)
            with timed(report["timings"], "interreflection"):
                transfer = transport.transfer()
        else:
            transfer = _bake_receivers(scene, settings, receivers, threads, folder, track, report)
    report["errors"] = dict(transfer.certificate)
    report["counts"] |= {"channels": transfer.channels, "bytes": transfer.nbytes}
    return transfer


def trace(
    scene: Scene,
    *,
    quality: str = "good",
    order: int | None = None,
    rays: int | None = None,
    bounces: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    checkpoint: str | Path | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> Transport:
    """The first half of `bake`, same arguments: what rays find at the scene's own vertices.

    `.transfer(bounces, albedo=...)` gives transfer for any albedo, with gradients to it.
    """
    settings = BakeSettings.of(quality, order=order, rays=rays, bounces=bounces, seed=seed)
    report = {} if report is None else report
    report |= {"settings": settings.as_dict(), "timings": {}, "counts": {}}
    folder = Path(checkpoint) if checkpoint is not None else None
    return _trace(scene, settings, None, threads, folder, track, report)


def _trace(
    scene: Scene,
    settings: BakeSettings,
    receivers: Receivers | None,
    threads: int | None,
    folder: Path | None,
    track: Track,
    report: dict,
) -> Transport:
    """Traces the given receivers, or the scene's own."""
    if threads is not None and threads < 1:
        raise InputError(f"threads is {threads}: give 1 or more, or leave it out to use all {default_threads()}")
    threads = threads or default_threads()
    with timed(report["timings"], "acceleration structure"):
        surfaces = Surfaces.of(scene)
        mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    receivers = surfaces.receivers if receivers is None else receivers
    transport = trace_transport(
        surfaces,
        mesh,
        receivers,
        settings,
        scene_hash=scene.hash(),
        threads=threads,
        folder=folder,
        track=track,
        report=report,
    )
    operator = transport.operator
    report["counts"] |= {
        "threads": threads,
        "triangles": len(surfaces.faces),
        "receivers": len(receivers),
        "rays": len(receivers) * settings.rays,
        "operator_entries": operator.entries if operator is not None else 0,
    }
    return transport


def _bake_receivers(
    scene: Scene,
    settings: BakeSettings,
    receivers: Receivers,
    threads: int | None,
    folder: Path | None,
    track: Track,
    report: dict,
) -> Transfer:
    """Transfer of free receivers: their last bounce gathers what the scene's own vertices reflect."""
    inner = None if folder is None else folder / "receivers"
    if settings.bounces == 0:
        return _trace(scene, settings, receivers, threads, folder, track, report).transfer()
    own = _trace(scene, settings, None, threads, folder, track, report)
    before = own.transfer(settings.bounces - 1)
    transport = _trace(scene, settings, receivers, threads, inner, track, report)
    albedo = own.receivers.albedo
    if bool((albedo == albedo[:, :1]).all()):
        albedo = albedo[:, :1]
    gathered = transport.operator.gather(albedo[:, :, None] * before.diffuse)
    return transport.as_transfer(transport.direct + gathered, settings.bounces)
