"""Diffuse bakes: shadows, then interreflection, for scenes without BRDFs."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.options.bake import CONVERGED, BakeSettings
from diffprt.progress import Track, timed, untracked
from diffprt.scene import Scene
from diffprt.surface.receivers import Receivers
from diffprt.surface.sides import Sides
from diffprt.transfer.baking.estimate import FEW_RAYS, Estimate, check_memory, check_time, fits
from diffprt.transfer.baking.job import Job, JobOptions
from diffprt.transfer.baking.sampling_rate import SamplingRate, rate_for_tolerance
from diffprt.transfer.baking.trial import TrialReceivers
from diffprt.transfer.diffuse.direct import open_transfer
from diffprt.transfer.diffuse.estimate import diffuse_memory, estimate_diffuse
from diffprt.transfer.diffuse.inside import Fill, find_inside
from diffprt.transfer.diffuse.signal import Transfer
from diffprt.transfer.diffuse.timed import TimedRate, timed_rate
from diffprt.transfer.diffuse.tracing import Tracing
from diffprt.transfer.diffuse.transport import Transport, trace_transport


class DiffuseJob(Job):
    """A bake of diffuse transfer (Sloan, Kautz and Snyder 2002)."""

    def __init__(self, scene: Scene, options: JobOptions) -> None:
        super().__init__(scene, options)
        given = next((name for name in ("order_out", "bounce_rays") if getattr(options, name) is not None), None)
        if given is not None:
            raise InputError(
                f"{given} is given, and no material of scene '{scene.name}' has a BRDF: exit radiance has bands where "
                "surfaces are glossy, leave it out"
            )
        self._estimates: dict[bool, Estimate] = {}
        self._rays: torch.Tensor | None = None
        # Of the seconds asked for, while the bake was prepared.
        self._spent = 0.0

    @property
    def shadows(self) -> bool:
        """Whether rays are traced at all."""
        plan = self.options.plan
        return plan is None or bool(plan.shadows.value)

    @cached_property
    def sampling(self) -> SamplingRate | None:
        """Traced on first use."""
        options = self.options
        if not self.shadows:
            return None
        if options.tolerance is not None:
            return rate_for_tolerance(self._trials, options.tolerance)
        return options.sampling if self._timed is None else self._timed.sampling

    @property
    def _trials(self) -> TrialReceivers:
        fill = self._own_hidden[1] if self.options.fill_inside else None
        return TrialReceivers(self.surfaces, self._asked, fill, self.threads)

    @cached_property
    def _timed(self) -> TimedRate | None:
        """What is to be done in the seconds that are asked for; None where none are."""
        if self.deadline is None or not self.shadows:
            return None
        begun = time.monotonic()
        rate = timed_rate(self.deadline, self.surfaces, self.options, self._asked, self._trials, self.threads)
        self._spent = time.monotonic() - begun
        return rate

    @property
    def _asked(self) -> BakeSettings:
        plan = self.options.plan
        planned = {} if plan is None else {"order": plan.order.value, "bounces": plan.bounces.value}
        return self.options.settings(**planned)

    @cached_property
    def settings(self) -> BakeSettings:
        if not self.shadows:
            return replace(self._asked, bounces=0)
        if self._timed is not None:
            return replace(self._asked, rays=self._timed.rays)
        return self._asked if self.sampling is None else replace(self._asked, rays=self.sampling.rays)

    def estimate(self) -> Estimate:
        receivers = self.options.receivers
        if receivers is None or self.settings.bounces == 0:
            return self._estimate(receivers)
        own, last = self._estimate(None), self._estimate(receivers)
        seconds, rays = own.seconds + last.seconds, own.rays + last.rays
        return replace(last, seconds=seconds, rays=rays, memory_bytes=max(own.memory_bytes, last.memory_bytes))

    def _estimate(self, receivers: Receivers | None) -> Estimate:
        """Of tracing the given receivers, or the scene's own."""
        key = receivers is None
        if key not in self._estimates:
            traced = self.surfaces.receivers if receivers is None else receivers
            self._estimates[key] = estimate_diffuse(self.surfaces, traced, self.settings, self._wanted, self.threads)
        return self._estimates[key]

    @property
    def _wanted(self) -> str:
        """The operator that is asked for, or that the seconds call for."""
        return self.options.operator if self._timed is None else self._timed.operator

    def _operator(self, receivers: Receivers | None) -> str:
        """ "stored" or "recompute", for a bake that fits; small ones are only estimated if that was asked for."""
        settings, options = self.settings, self.options
        traced = self.surfaces.receivers if receivers is None else receivers
        if (receivers is None) not in self._estimates:
            rays = traced.sides * settings.rays
            most = min(3 * rays, traced.sides * len(self.surfaces.receivers)) if settings.reflects else 0
            kind = "stored" if self._wanted == "auto" else self._wanted
            needed = diffuse_memory(self.surfaces, traced, settings, most, kind, self.threads)
            if rays <= FEW_RAYS and fits(needed, 0.5):
                return kind
        estimate = self._estimate(receivers)
        remedies = ["fewer --rays", "a coarser mesh"]
        if settings.reflects:
            remedies += ["--operator recompute"] if estimate.operator == "stored" else ["--bounces 0"]
        check_memory(estimate.memory_bytes, remedies)
        hours = options.hours if options.seconds is None else math.inf
        check_time(estimate, hours, "bound it with --seconds or fewer --rays")
        return estimate.operator

    def trace(
        self,
        receivers: Receivers | None = None,
        *,
        checkpoint: str | Path | None = None,
        track: Track = untracked,
        report: dict | None = None,
    ) -> Transport:
        """What rays find at the given receivers, or at the scene's own."""
        report = self._begun(report)
        timings, surfaces, settings = report["timings"], self.surfaces, self.settings
        traced = surfaces.receivers if receivers is None else receivers
        if self.shadows:
            with timed(timings, "estimating"):
                keep_hits = self._operator(receivers) == "stored"
                pace = None if self._timed is None else self._timed.pace(self.deadline, receivers)
            with timed(timings, "compiling kernels"):
                tracing = Tracing(
                    surfaces, traced, settings, scene_hash=self.scene.hash(), keep_hits=keep_hits, pace=pace
                )
                tracing.ready(self.threads)
            with timed(timings, "receivers inside geometry"):
                inside, fill = self._hidden(receivers)
            transport = trace_transport(
                tracing,
                fill=fill,
                threads=self.threads,
                folder=None if checkpoint is None else Path(checkpoint),
                track=track,
                report=report,
            )
            if inside is not None:
                found = {**transport.findings, "receivers_inside": int(inside.sum())}
                transport = replace(transport, findings=found)
        else:
            sides = Sides.of(traced)
            direct = open_transfer(traced.normals if sides is None else sides.traced.normals, settings.order)
            direct = direct.float()[:, None]
            direct = direct if sides is None else sides.combined(direct)
            transport = Transport(traced, direct, torch.zeros_like(direct), None, settings, self.scene.hash())
        self._rays = transport.rays
        report["counts"] |= {
            "threads": self.threads,
            "triangles": len(surfaces.faces),
            "receivers": len(traced),
            "rays": transport.rays_traced,
            "operator_entries": transport.operator.entries if transport.operator is not None else 0,
        }
        return transport

    def _hidden(self, receivers: Receivers | None) -> tuple[torch.Tensor | None, Fill | None]:
        """The given receivers, or the scene's own, that are inside geometry, and how they are filled."""
        if not self.options.fill_inside or not self.shadows:
            return None, None
        if receivers is None:
            return self._own_hidden
        inside = find_inside(self.surfaces, receivers, self.threads)
        return inside, Fill.of(receivers, inside)

    @cached_property
    def _own_hidden(self) -> tuple[torch.Tensor, Fill | None]:
        """Found once, for trials and for the bake."""
        inside = find_inside(self.surfaces, self.surfaces.receivers, self.threads)
        return inside, Fill.of(self.surfaces.receivers, inside)

    def _begun(self, report: dict | None) -> dict:
        """A report with its settings."""
        report = {} if report is None else report
        report |= {"timings": report.get("timings", {}), "counts": report.get("counts", {})}
        with timed(report["timings"], "choosing rays"):
            report["settings"] = self.settings.as_dict()
        return report

    def run(
        self, *, checkpoint: str | Path | None = None, track: Track = untracked, report: dict | None = None
    ) -> Transfer:
        if checkpoint is not None and self.deadline is not None:
            raise InputError(
                f"checkpoint is {checkpoint}, and seconds is {self.deadline.seconds:g}: rays that the clock chose "
                "cannot be chosen again, give one of them"
            )
        if self.deadline is not None and self.options.begun is None:
            # What passes between preparing and running is none of its time.
            self.deadline = replace(self.deadline, begun=time.monotonic() - self._spent)
        report = {} if report is None else report
        report |= {"timings": {}, "counts": {}}
        folder = None if checkpoint is None else Path(checkpoint)
        with timed(report["timings"], "total"):
            transfer = self._bake(folder, track, self._begun(report))
        return self._certified(transfer, report)

    def _bake(self, folder: Path | None, track: Track, report: dict) -> Transfer:
        """Free receivers gather, in their last bounce, what the scene's own vertices reflect."""
        given, bounces = self.options.receivers, self.settings.bounces
        channels = None if self.options.plan is None else self.options.plan.channels.value
        if given is not None and bounces == 0:
            return self.trace(given, checkpoint=folder, track=track, report=report).transfer()
        transport = self.trace(checkpoint=folder, track=track, report=report)
        if given is None:
            with timed(report["timings"], "interreflection"):
                return transport.transfer(channels=channels)
        before = transport.transfer(bounces if bounces == CONVERGED else bounces - 1, channels=channels)
        folder = None if folder is None else folder / "receivers"
        transport = self.trace(given, checkpoint=folder, track=track, report=report)
        with timed(report["timings"], "interreflection"):
            albedo = before.receivers.albedo
            if channels == 1 or bool((albedo == albedo[:, :1]).all()):
                albedo = albedo.mean(1, keepdim=True)
            gathered = transport.operator.gather(albedo[:, :, None] * before.diffuse)
            ended = {k: v for k, v in before.certificate.items() if k.startswith("convergence")}
            return transport.as_transfer(transport.direct + gathered, before.settings["bounces"] + 1, findings=ended)

    def _certified(self, transfer: Transfer, report: dict) -> Transfer:
        """With the plan, and with the error that the sampling stands for."""
        certificate = dict(transfer.certificate)
        if self.sampling is not None:
            certificate |= self.sampling.promised(certificate, self._rays)
            report["sampling"] = self.sampling.as_dict()
        report["errors"] = certificate
        counts = {"channels": transfer.channels, "bytes": transfer.nbytes, "bounces": transfer.settings["bounces"]}
        report["counts"] |= counts
        report["settings"] = transfer.settings
        plan = {} if self.options.plan is None else self.options.plan.as_dict()
        return transfer.labeled(replace(transfer.provenance, certificate=certificate, plan=plan))
