"""Glossy bakes: the shadow pass, then passes of light transport, for scenes whose materials have BRDFs."""

from __future__ import annotations

import warnings
from functools import cached_property
from pathlib import Path

from diffprt.brdf import check_brdf, is_own, mark, recorded
from diffprt.errors import InputError
from diffprt.options.bake import GlossySettings
from diffprt.progress import Track, timed, untracked
from diffprt.representation.provenance import Provenance
from diffprt.scene import Scene
from diffprt.transfer.baking.chunks import run_passes
from diffprt.transfer.baking.estimate import FEW_RAYS, Estimate, check_memory, check_time
from diffprt.transfer.baking.job import Job, JobOptions
from diffprt.transfer.glossy.estimate import estimate_glossy, glossy_memory
from diffprt.transfer.glossy.materials import GlossyMaterials, brdfs_of
from diffprt.transfer.glossy.passes import GlossyPasses
from diffprt.transfer.glossy.signal import GlossyTransfer

# What the passes have no use for yet.
_NOT_TAKEN = ("tolerance", "seconds", "receivers", "plan", "sampling")


class GlossyJob(Job):
    """A bake of glossy transfer at the scene's own vertices.

    Shadows are exact in the light's bands up to the sampling of visibility: see `transfer.glossy.visibility_matrix`.
    Albedo plays no part where a material has a BRDF. Gradients reach the parameters of the BRDFs; visibility is
    frozen. With bounces, the memory for gradients grows with the rays that hit something.
    """

    def __init__(self, scene: Scene, options: JobOptions) -> None:
        super().__init__(scene, options)
        given = next((name for name in _NOT_TAKEN if getattr(options, name) is not None), None)
        if given is None and options.operator != "auto":
            given = "operator"
        if given is not None:
            raise InputError(f"{given} is given with a BRDF: glossy bakes do not take it, leave one of them out")
        self.brdfs = brdfs_of(scene)
        for brdf in self.brdfs:
            check_brdf(brdf)
        if self._unsaved:
            warnings.warn(f"the asset can be used and not saved: {self._unsaved}", stacklevel=2)
        _ = self.settings

    @cached_property
    def settings(self) -> GlossySettings:
        return self.options.settings(GlossySettings)

    @property
    def saved(self) -> dict:
        """Settings as the asset has them."""
        return {**self.settings.as_dict(), "brdf": [recorded(b)[0] for b in self.brdfs]}

    @property
    def _unsaved(self) -> str:
        """Why a file cannot say what was baked; "" where it can."""
        return next((why for b in self.brdfs if (why := recorded(b)[1])), "")

    def _passes(self) -> GlossyPasses:
        settings = self.settings
        materials = GlossyMaterials.of(self.scene, settings.order, settings.order_out, settings.ridge)
        own = {"own BRDFs": [mark(b) for b in self.brdfs]} if any(is_own(b) for b in self.brdfs) else {}
        return GlossyPasses(self.surfaces, materials, settings, {**self.saved, **own, "scene": self.scene.hash()})

    @cached_property
    def _estimated(self) -> Estimate:
        return estimate_glossy(self.surfaces, self.settings, self._passes, self.threads)

    def estimate(self) -> Estimate:
        return self._estimated

    def _check(self) -> None:
        """Refuses what does not fit; small bakes are only estimated if that was asked for."""
        settings = self.settings
        needed = glossy_memory(self.surfaces, max(b.channels for b in self.brdfs), settings, self.threads)
        remedies = [f"a lower --order (now {settings.order})", f"a lower --order-out (now {settings.order_out})"]
        check_memory(needed, [*remedies, "a coarser mesh"])
        if "_estimated" in self.__dict__ or self._rays > FEW_RAYS:
            check_time(self.estimate(), self.options.hours, "use fewer --rays or --bounces")

    @property
    def _rays(self) -> int:
        settings = self.settings
        return len(self.surfaces.receivers) * (settings.rays + settings.bounces * settings.bounce_rays)

    def run(
        self, *, checkpoint: str | Path | None = None, track: Track = untracked, report: dict | None = None
    ) -> GlossyTransfer:
        self._check()
        report = {} if report is None else report
        report |= {"timings": {}, "counts": {}}
        timings, receivers = report["timings"], self.surfaces.receivers
        with timed(timings, "total"):
            with timed(timings, "BRDF matrices"):
                passes = self._passes()
            with timed(timings, "acceleration structure"):
                self.surfaces.mesh(self.threads)
            folder = None if checkpoint is None else Path(checkpoint)
            left = run_passes(passes, threads=self.threads, folder=folder, track=track, report=report)
            signal = left.transfer[passes.order.argsort()]
        noise, size = (left.squares / len(receivers)).sqrt().tolist()
        certificate = {"noise_rms": noise, "signal_rms": size, "noise_relative": noise / size if size > 0 else 0.0}
        made = Provenance(self.saved, {}, certificate, self.scene.hash(), self._unsaved)
        transfer = GlossyTransfer(signal, receivers, made)
        report["errors"], report["settings"] = certificate, transfer.settings
        report["counts"] |= {
            "threads": self.threads,
            "triangles": len(self.surfaces.faces),
            "receivers": len(receivers),
            "rays": self._rays,
            "bounces": self.settings.bounces,
            "channels": transfer.channels,
            "bytes": transfer.nbytes,
        }
        return transfer
