"""Trial traces of some receivers: the error that a number of rays would leave in the whole signal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.options.bake import CONVERGED, BakeSettings
from diffprt.scene import Scene
from diffprt.surface.operator import StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.direct import DirectTracer, direct_transfer
from diffprt.transfer.diffuse.tracing import Tracing
from diffprt.transfer.diffuse.transport import trace_transport

# The error of a sample falls like S^-1/2 and its cost grows like S: their sum is least near V^(2/3).
_LEAST_SAMPLE, _SAMPLE_SHARE = 64, 1.0
_SEEDS = 1 << 64


@dataclass(frozen=True)
class Trial:
    """What two independent traces with the same number of rays show.

    Attributes:
        error: relative root mean square error of one of them.
        uncertainty: relative standard error of `error`, since only some receivers were traced.
        noise_uncertainty: that of the ratio of `error` to the noise that halves of the rays show.
    """

    error: float
    uncertainty: float
    noise_uncertainty: float


class TrialReceivers:
    """Receivers of a scene drawn at random (by the seed) for trial traces.

    Attributes:
        traced: rays traced so far, over all receivers.
    """

    def __init__(self, scene: Scene, settings: BakeSettings, threads: int | None = None) -> None:
        self._surfaces = Surfaces.of(scene)
        self._mesh = self._surfaces.mesh(threads)
        self._settings, self._threads = settings, threads
        self._reflected: torch.Tensor | None = None
        # Traces of a bake use the seed itself, trials those after it.
        self._seed = settings.seed
        self.traced = 0
        every = self._surfaces.receivers
        size = min(max(round(_SAMPLE_SHARE * len(every) ** (2 / 3)), _LEAST_SAMPLE), len(every))
        generator = torch.Generator().manual_seed(settings.seed & 0x7FFFFFFFFFFFFFFF)
        pick = torch.randperm(len(every), generator=generator)[:size].sort().values
        receivers = some_receivers(every, pick, self._mesh.ray_offset())
        self._sides = Sides.of(receivers)
        self._receivers = receivers if self._sides is None else self._sides.traced

    def see_reflections(self, rays: int) -> None:
        """From now on trials include interreflection: every receiver is traced with `rays`, for what it reflects.

        What a trial gathers averages over many of them, so that few rays will do.
        """
        every = self._surfaces.receivers
        bounces = self._settings.bounces
        before = bounces if bounces == CONVERGED else bounces - 1
        settings = replace(self._settings, rays=rays, bounces=before, seed=self._next_seed())
        transport = trace_transport(Tracing(self._surfaces, every, settings), threads=self._threads)
        self.traced += rays * every.sides
        self._reflected = reflected_light(self._surfaces, transport.transfer().diffuse)

    def measure(self, rays: int) -> Trial:
        """Traces the sample twice, independently, with `rays` each."""
        (a, noise_a), (b, noise_b) = self._trace(rays), self._trace(rays)
        # Sums over coefficients, means over channels: one number per receiver.
        error = ((a - b).square().sum(-1).mean(1)) / 2
        noise = (noise_a.square() + noise_b.square()).sum(-1).mean(1) / 2
        signal = float(((a + b) / 2).square().sum(-1).mean())
        size = float(error.mean())
        if size == 0:
            return Trial(0.0, 0.0, 0.0)
        ratio = size / float(noise.mean()) if bool(noise.any()) else 1.0

        def uncertainty(deviation: torch.Tensor) -> float:
            # Of a square root: half of that of the mean square.
            return float(deviation.std()) / math.sqrt(len(error)) / size / 2 if len(error) > 1 else 0.0

        return Trial(math.sqrt(size / signal), uncertainty(error), uncertainty(error - ratio * noise))

    def noise(self, rays: int) -> float:
        """The noise that a bake with `rays` would find by itself: that of its two halves, relative as in a trial."""
        signal, error = self._trace(rays)
        size = float(signal.square().sum(-1).mean())
        return math.sqrt(float(error.square().sum(-1).mean()) / size) if size > 0 else 0.0

    def _trace(self, rays: int) -> tuple[torch.Tensor, torch.Tensor]:
        self.traced += rays * len(self._receivers)
        transfer, error = trace_some(
            self._surfaces,
            self._mesh,
            self._receivers,
            self._surfaces.pattern(self._receivers, rays, self._next_seed()),
            self._settings.order,
            reflected=self._reflected,
            threads=self._threads,
        )
        if self._sides is None:
            return transfer, error
        return self._sides.combined(transfer), self._sides.combined_error(error)

    def _next_seed(self) -> int:
        self._seed = (self._seed + 1) % _SEEDS
        return self._seed


def some_receivers(receivers: Receivers, pick: torch.Tensor, offset: float) -> Receivers:
    """The receivers `pick` int64 [S], without triangles, yet with rays that start where theirs do.

    Args:
        offset: as in `Receivers.origins`, which moves receivers on a border inwards.
    """
    positions = (receivers.origins(offset).double() - offset * receivers.normals.double()).float()
    return replace(receivers, positions=positions, albedo=receivers.albedo.detach()).picked(pick)


def reflected_light(surfaces: Surfaces, transfer: torch.Tensor) -> torch.Tensor:
    """Albedo times `transfer` [V, C, K] of the scene's own receivers; C is 1 where nothing is colored."""
    albedo = surfaces.receivers.albedo.detach()
    return (albedo if surfaces.colored else albedo[:, :1])[:, :, None] * transfer


def trace_some(
    surfaces: Surfaces,
    mesh: TriangleMesh,
    receivers: Receivers,
    pattern: Pattern,
    order: int,
    *,
    reflected: torch.Tensor | None = None,
    threads: int | None = None,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Transfer of `receivers`, whose last bounce gathers `reflected`; no operator is kept.

    Args:
        reflected: [V, C, K], see `reflected_light`; None for direct transfer.

    Returns:
        Transfer float64 [S, C, K], and the standard error of its direct part [S, 1, K] as of `direct_transfer`.
    """
    sources = len(surfaces.receivers)
    corners = None if reflected is None else surfaces.source_of_corner.numpy()
    tracer = DirectTracer(mesh, receivers, pattern, order, corners, sources)
    parts: dict[int, tuple] = {}

    def work(chunk: int) -> None:
        sums, blocked, rows = tracer.trace(chunk)
        gathered = None if rows is None else StoredOperator([rows], sources).gather(reflected)
        parts[chunk] = torch.from_numpy(sums), torch.from_numpy(blocked), gathered

    for _ in run_chunks(work, range(len(tracer.cut)), threads=threads):
        pass
    sums, blocked, gathered = zip(*(parts[chunk] for chunk in range(len(tracer.cut))), strict=True)
    direct, error = direct_transfer(receivers.normals, torch.cat(sums, dim=1), torch.cat(blocked), tracer.rays)
    transfer = direct.double() if reflected is None else direct.double() + torch.cat(gathered).double()
    return transfer, error.double()
