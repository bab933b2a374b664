"""Traced light transport: direct transfer and the bounce operator, from which transfer follows for any albedo."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.options.bake import CONVERGED, BakeSettings
from diffprt.progress import Track, timed, untracked
from diffprt.representation.provenance import Provenance
from diffprt.surface.operator import BounceOperator, StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.transfer.baking.chunks import run_passes
from diffprt.transfer.diffuse.convergence import converge
from diffprt.transfer.diffuse.direct import direct_transfer
from diffprt.transfer.diffuse.inside import Fill, FilledOperator
from diffprt.transfer.diffuse.interreflection import interreflect
from diffprt.transfer.diffuse.openness import bent_normals, openness
from diffprt.transfer.diffuse.retrace import RetracedOperator
from diffprt.transfer.diffuse.sheets import SheetOperator
from diffprt.transfer.diffuse.signal import Transfer
from diffprt.transfer.diffuse.tracing import Tracing


@dataclass(frozen=True)
class Transport:
    """What rays found, constant in the material; visibility is frozen and carries no gradient.

    Attributes:
        receivers: where transfer is wanted.
        direct: float32 [V, 1, K], transfer without interreflection; where translucent, of both sides.
        error: float32 [V, 1, K], its standard error.
        operator: G [V, sources]; None when no bounce was traced.
        settings: what it was traced with.
        scene_hash: of the scene.
        findings: what tracing adds to the certificate.
        rays: int64 [sides], traced from each; None where nothing was traced.
    """

    receivers: Receivers
    direct: torch.Tensor
    error: torch.Tensor
    operator: BounceOperator | None
    settings: BakeSettings
    scene_hash: str
    findings: dict = field(default_factory=dict)
    rays: torch.Tensor | None = None

    @property
    def rays_traced(self) -> int:
        """From all receivers."""
        return 0 if self.rays is None else int(self.rays.sum())

    def transfer(
        self, bounces: int | str | None = None, *, albedo: torch.Tensor | None = None, channels: int | None = None
    ) -> Transfer:
        """Transfer after `bounces` interreflections among these receivers.

        Args:
            bounces: a number, or "converged"; without it, what was asked when tracing.
            albedo: [V, 3], [V, 1] or [3], in [0, 1]; without it the receivers' own. Gradients reach it, and the
                receivers of the result have it, so that `shade` uses it too.
            channels: 1 lets surfaces light each other by their mean albedo; without it, 3 where colors differ.

        Raises:
            InputError: bounces without a traced operator, an albedo of another shape or range, or light that
                never leaves (see `converge`).
        """
        bounces = self.settings.bounces if bounces is None else bounces
        if bounces != 0 and self.operator is None:
            raise InputError(
                f"{bounces} bounces were asked of transport traced without any: trace with bounces=1 or more"
            )
        receivers = self.receivers if albedo is None else self.receivers.with_albedo(albedo)
        reflectance = receivers.albedo
        if channels == 1:
            reflectance = reflectance.mean(1, keepdim=True)
        elif not reflectance.requires_grad and bool((reflectance == reflectance[:, :1]).all()):
            reflectance = reflectance[:, :1]
        if bounces == 0:
            return self.as_transfer(self.direct, 0, receivers)
        direct = self.direct.expand(-1, reflectance.shape[1], -1)
        if bounces != CONVERGED:
            return self.as_transfer(interreflect(direct, self.operator, reflectance, bounces), bounces, receivers)
        signal, ended = converge(direct, self.operator, reflectance)
        return self.as_transfer(signal, ended.products, receivers, ended.as_certificate())

    @property
    def elements(self) -> Receivers:
        """The receivers, as every asset calls what carries its signal."""
        return self.receivers

    def check_albedo(self) -> None:
        """Nothing to refuse: the albedo is left out, as of `Transfer`."""

    def as_transfer(
        self, signal: torch.Tensor, bounces: int, receivers: Receivers | None = None, findings: dict | None = None
    ) -> Transfer:
        """`signal` [V, C, K] at these receivers, with settings and certificate; `findings` join the latter."""
        return Transfer(
            signal.contiguous(),
            receivers or self.receivers,
            Provenance(
                {**self.settings.as_dict(), "bounces": bounces},
                certificate=_certificate(signal.detach(), self.error) | self.findings | (findings or {}),
                scene_hash=self.scene_hash,
            ),
            openness(self.direct),
            bent_normals(self.direct, self.receivers.normals),
        )


def trace_transport(
    tracing: Tracing,
    *,
    fill: Fill | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    track: Track = untracked,
    report: dict | None = None,
) -> Transport:
    """Traces receivers in resumable chunks.

    Args:
        fill: which receivers are filled from others; None for none.
        threads: CPU threads; all that the process may use without it.
        folder: where finished chunks live; None keeps them in memory.
        report: its "timings" and "counts" are added to.

    Raises:
        InputError: the folder belongs to another bake or cannot be written.
        Interrupted: Ctrl-C.
    """
    receivers, settings, sides, order = tracing.receivers, tracing.settings, tracing.sides, tracing.order
    report = {} if report is None else report
    threads = threads or default_threads()
    traced = run_passes(tracing, threads=threads, folder=folder, track=track, report=report)
    with timed(report["timings"], "gathering chunks"):
        place = order.argsort()
        direct = direct_transfer(tracing.ordered.normals, traced.sums, traced.blocked, traced.rays)
        direct, error = (part[place] for part in direct)
        operator: BounceOperator | None = None
        if tracing.keeps_hits:
            operator = StoredOperator(traced.rows, len(tracing.surfaces.receivers), order)
        elif settings.reflects:
            operator = RetracedOperator(tracing, traced.rays, threads)
        if sides is not None:
            direct, error = sides.combined(direct), sides.combined_error(error)
            operator = SheetOperator(operator, sides) if operator is not None else None
    if fill is not None:
        direct, error = fill.apply(direct), fill.apply(error)
        operator = FilledOperator(operator, fill) if operator is not None else None
    findings = {}
    fewest, most = int(traced.rays.min()), int(traced.rays.max())
    if fewest < most:
        findings = {"rays_fewest": fewest, "rays_mean": float(traced.rays.double().mean()), "rays_most": most}
    settings = replace(settings, rays=fewest)
    return Transport(receivers, direct, error, operator, settings, tracing.scene_hash, findings, traced.rays)


def _certificate(signal: torch.Tensor, error: torch.Tensor) -> dict:
    """Noise of the direct part, as a share of the signal (root mean squares over receivers)."""
    size = float(signal.double().square().sum(-1).mean().sqrt())
    noise = float(error.double().square().sum(-1).mean().sqrt())
    if not np.isfinite(noise):
        return {}
    return {"noise_rms": noise, "signal_rms": size, "noise_relative": noise / size if size > 0 else 0.0}
