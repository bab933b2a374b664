"""Trial traces of some receivers: the error that a number of rays would leave in the whole signal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from diffprt.options.bake import CONVERGED, BakeSettings
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.inside import Fill
from diffprt.transfer.diffuse.picked import PickedReceivers, reflected_light
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

    Args:
        surfaces: the scene.
        settings: of the bake.
        fill: what the bake fills; None where it fills nothing.
        threads: CPU threads.

    Attributes:
        settings: of the bake.
        traced: rays traced so far, over all receivers.
    """

    def __init__(
        self, surfaces: Surfaces, settings: BakeSettings, fill: Fill | None = None, threads: int | None = None
    ) -> None:
        self._surfaces, self.settings, self._fill, self._threads = surfaces, settings, fill, threads
        self._reflected: torch.Tensor | None = None
        # Traces of a bake use the seed itself, trials those after it.
        self._seed = settings.seed
        self.traced = 0
        every = surfaces.receivers
        size = min(max(round(_SAMPLE_SHARE * len(every) ** (2 / 3)), _LEAST_SAMPLE), len(every))
        generator = torch.Generator().manual_seed(settings.seed & 0x7FFFFFFFFFFFFFFF)
        pick = torch.randperm(len(every), generator=generator)[:size].sort().values
        self._picked = PickedReceivers(surfaces, pick, fill, threads)
        self._draw = self._picked.alike.unique(return_inverse=True)[1]

    def see_reflections(self, rays: int) -> None:
        """From now on trials include interreflection: every receiver is traced with `rays`, for what it reflects.

        What a trial gathers averages over many of them, so that few rays will do.
        """
        every = self._surfaces.receivers
        bounces = self.settings.bounces
        before = bounces if bounces == CONVERGED else bounces - 1
        settings = replace(self.settings, rays=rays, bounces=before, seed=self._next_seed())
        transport = trace_transport(Tracing(self._surfaces, every, settings), fill=self._fill, threads=self._threads)
        self.traced += rays * every.sides
        self._reflected = reflected_light(self._surfaces, transport.transfer().diffuse)

    def reflection_rays(self, rays: int) -> int:
        """What `see_reflections` traces, over all receivers."""
        return rays * self._surfaces.receivers.sides

    @property
    def traced_at_a_time(self) -> int:
        """Hemispheres of one trace."""
        return self._picked.traced

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
            # Receivers with the same mean err together: their sum is one draw. Of a square root: half of that of the
            # mean square.
            draws = torch.zeros_like(deviation).index_add_(0, self._draw, deviation - deviation.mean())
            spread = float(draws.square().sum().sqrt()) / len(error)
            return spread / size / 2

        return Trial(math.sqrt(size / signal), uncertainty(error), uncertainty(error - ratio * noise))

    def noise(self, rays: int) -> float:
        """The noise that a bake with `rays` would find by itself: that of its two halves, relative as in a trial."""
        signal, error = self._trace(rays)
        size = float(signal.square().sum(-1).mean())
        return math.sqrt(float(error.square().sum(-1).mean()) / size) if size > 0 else 0.0

    def _trace(self, rays: int) -> tuple[torch.Tensor, torch.Tensor]:
        self.traced += rays * self._picked.traced
        return self._picked.trace(rays, self._next_seed(), self.settings.order, reflected=self._reflected)

    def _next_seed(self) -> int:
        self._seed = (self._seed + 1) % _SEEDS
        return self._seed
