"""Baking: from a scene to the transfer of its receivers."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.options.bake import CONVERGED, OPERATORS, BakeOptions
from diffprt.planning import Plan
from diffprt.progress import Track, timed, untracked
from diffprt.scene import Scene
from diffprt.surface.receivers import Receivers
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.estimate import choose_operator
from diffprt.transfer.baking.sampling_rate import SamplingRate, choose_rays
from diffprt.transfer.diffuse.direct import open_transfer
from diffprt.transfer.diffuse.signal import Transfer
from diffprt.transfer.diffuse.transport import Transport, trace_transport


def bake(
    scene: Scene,
    *,
    receivers: Receivers | None = None,
    quality: str = "good",
    order: int | None = None,
    rays: int | None = None,
    bounces: int | str | None = None,
    seed: int = 0,
    tolerance: float | None = None,
    seconds: float | None = None,
    plan: Plan | None = None,
    sampling: SamplingRate | None = None,
    fill_inside: bool = True,
    operator: str = "auto",
    hours: float = 1.0,
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
        bounces: diffuse interreflections; "converged" solves for all of them, to 1e-4 of direct transfer.
        seed: the same seed gives the same bytes for any number of threads.
        tolerance: instead of rays: the relative root mean square error that sampling may leave, such as 0.01.
        seconds: instead of rays: about how long this machine may work; the bytes then depend on its speed.
        plan: which effects to simulate; `order` and `bounces` given beside it take precedence.
        sampling: what `choose_rays` found beside these rays, for the certificate; `tolerance` and `seconds` find it.
        fill_inside: give receivers that lie inside other geometry the mean of their neighbors outside: nobody sees
            them, but interpolation would carry their black out.
        operator: "stored" keeps what rays hit for the bounces, "recompute" traces again for each of them, "auto"
            stores it where memory allows. The signal is the same.
        hours: refuse, before tracing, what is expected to take longer; `seconds` takes precedence.
        threads: CPU threads; all that the process may use without it.
        checkpoint: folder for finished chunks. A bake that was killed goes on from there to the same bytes. It
            stays when the bake ends: `discard_chunks` it once the asset is saved.
        track: `track(text, total, done)`, a context manager that yields what to call after each chunk.
        report: filled with timings, counts and errors.

    Returns:
        `Transfer` with its settings and certificate. Gradients reach the scene's albedo through the bounces, if
        it asks for them; visibility is frozen. `trace` gives the form for many albedos.

    Raises:
        InputError: an option is out of range; the bake would not fit into memory or into `hours`; light never leaves;
            the scene is too far from the origin for 32-bit coordinates.
        Interrupted: Ctrl-C; with a checkpoint nothing finished is lost.
    """
    run = _Run(
        scene,
        quality=quality,
        order=order,
        rays=rays,
        bounces=bounces,
        seed=seed,
        tolerance=tolerance,
        seconds=seconds,
        plan=plan,
        sampling=sampling,
        fill_inside=fill_inside,
        operator=operator,
        hours=hours,
        threads=threads,
        checkpoint=checkpoint,
        track=track,
        report=report,
    )
    with run.timed("total"):
        transfer = run.bake_own() if receivers is None else run.bake_free(receivers)
    return run.certified(transfer)


def trace(
    scene: Scene,
    *,
    quality: str = "good",
    order: int | None = None,
    rays: int | None = None,
    bounces: int | str | None = None,
    seed: int = 0,
    fill_inside: bool = True,
    operator: str = "auto",
    hours: float = 1.0,
    threads: int | None = None,
    checkpoint: str | Path | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> Transport:
    """The first half of `bake`, same arguments: what rays find at the scene's own vertices.

    `.transfer(bounces, albedo=...)` gives transfer for any albedo, with gradients to it.
    """
    run = _Run(
        scene,
        quality=quality,
        order=order,
        rays=rays,
        bounces=bounces,
        seed=seed,
        tolerance=None,
        seconds=None,
        plan=None,
        sampling=None,
        fill_inside=fill_inside,
        operator=operator,
        hours=hours,
        threads=threads,
        checkpoint=checkpoint,
        track=track,
        report=report,
    )
    return run.trace()


class _Run:
    """The options of one bake, resolved: how many rays, which effects, where chunks and progress go."""

    def __init__(
        self,
        scene: Scene,
        *,
        quality: str,
        order: int | None,
        rays: int | None,
        bounces: int | str | None,
        seed: int,
        tolerance: float | None,
        seconds: float | None,
        plan: Plan | None,
        sampling: SamplingRate | None,
        fill_inside: bool,
        operator: str,
        hours: float,
        threads: int | None,
        checkpoint: str | Path | None,
        track: Track,
        report: dict | None,
    ) -> None:
        if threads is not None and threads < 1:
            raise InputError(f"threads is {threads}: give 1 or more, or leave it out to use all {default_threads()}")
        if operator not in OPERATORS:
            raise InputError(f"operator is '{operator}': use one of {', '.join(OPERATORS)}")
        if not hours > 0:
            raise InputError(f"hours is {hours}: give a positive time, such as 1")
        if plan is not None:
            order = plan.order.value if order is None else order
            bounces = plan.bounces.value if bounces is None else bounces
        settings = BakeOptions(quality=quality, order=order, rays=rays, bounces=bounces, seed=seed).settings()
        self.scene, self.plan = scene, plan
        self.fill_inside, self.operator = fill_inside, operator
        self.hours = hours if seconds is None else math.inf
        self.threads = threads or default_threads()
        self.folder = Path(checkpoint) if checkpoint is not None else None
        self.track = track
        self.report = {} if report is None else report
        self.report |= {"timings": {}, "counts": {}}
        self.sampling = sampling if self.shadows else None
        if self.shadows and sampling is None:
            with self.timed("choosing rays"):
                settings, self.sampling = choose_rays(
                    scene, settings, rays=rays, tolerance=tolerance, seconds=seconds, threads=threads
                )
        self.settings = settings if self.shadows else replace(settings, bounces=0)
        self.report["settings"] = self.settings.as_dict()
        self.channels = None if plan is None else plan.channels.value

    @property
    def shadows(self) -> bool:
        """Whether rays are traced at all."""
        return self.plan is None or bool(self.plan.shadows.value)

    def timed(self, stage: str) -> AbstractContextManager[None]:
        """Adds the block's seconds to the report."""
        return timed(self.report["timings"], stage)

    def trace(self, receivers: Receivers | None = None, folder: Path | None = None) -> Transport:
        """Traces the given receivers, or the scene's own."""
        surfaces = Surfaces.of(self.scene)
        receivers = surfaces.receivers if receivers is None else receivers
        if self.shadows:
            with self.timed("estimating"):
                operator = choose_operator(
                    self.scene, self.settings, receivers, self.operator, hours=self.hours, threads=self.threads
                )
            with self.timed("acceleration structure"):
                mesh = TriangleMesh(surfaces.positions, surfaces.faces, threads=self.threads)
            transport = trace_transport(
                surfaces,
                mesh,
                receivers,
                self.settings,
                scene_hash=self.scene.hash(),
                threads=self.threads,
                folder=folder or self.folder,
                track=self.track,
                report=self.report,
                store_operator=operator == "stored",
                fill_inside=self.fill_inside,
            )
        else:
            sides = Sides.of(receivers)
            normals = receivers.normals if sides is None else sides.traced.normals
            direct = open_transfer(normals, self.settings.order).float()[:, None]
            direct = direct if sides is None else sides.combined(direct)
            nothing = torch.zeros_like(direct)
            transport = Transport(receivers, direct, nothing, None, self.settings, self.scene.hash())
        self.report["counts"] |= {
            "threads": self.threads,
            "triangles": len(surfaces.faces),
            "receivers": len(receivers),
            "rays": receivers.sides * self.settings.rays if self.shadows else 0,
            "operator_entries": transport.operator.entries if transport.operator is not None else 0,
        }
        return transport

    def bake_own(self) -> Transfer:
        """Transfer of the scene's own vertices."""
        transport = self.trace()
        with self.timed("interreflection"):
            return transport.transfer(channels=self.channels)

    def bake_free(self, receivers: Receivers) -> Transfer:
        """Transfer of free receivers: their last bounce gathers what the scene's own vertices reflect."""
        bounces = self.settings.bounces
        if bounces == 0:
            return self.trace(receivers).transfer()
        before = self.trace().transfer(bounces if bounces == CONVERGED else bounces - 1, channels=self.channels)
        transport = self.trace(receivers, None if self.folder is None else self.folder / "receivers")
        with self.timed("interreflection"):
            albedo = before.receivers.albedo
            if self.channels == 1 or bool((albedo == albedo[:, :1]).all()):
                albedo = albedo.mean(1, keepdim=True)
            gathered = transport.operator.gather(albedo[:, :, None] * before.diffuse)
            ended = {k: v for k, v in before.certificate.items() if k.startswith("convergence")}
            return transport.as_transfer(transport.direct + gathered, before.settings["bounces"] + 1, findings=ended)

    def certified(self, transfer: Transfer) -> Transfer:
        """With the plan, and with the error that the sampling stands for."""
        certificate = dict(transfer.certificate)
        if self.sampling is not None:
            certificate["expected_error"] = self.sampling.expected_error
            if "noise_relative" in certificate:
                certificate["estimated_error"] = certificate["noise_relative"] * self.sampling.correction
            self.report["sampling"] = self.sampling.as_dict()
        self.report["errors"] = certificate
        counts = {"channels": transfer.channels, "bytes": transfer.nbytes, "bounces": transfer.settings["bounces"]}
        self.report["counts"] |= counts
        plan = {} if self.plan is None else self.plan.as_dict()
        return transfer.labeled(replace(transfer.provenance, certificate=certificate, plan=plan))
