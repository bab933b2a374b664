"""What a tolerance is measured against: a far finer bake, and the fewest fixed rays that would have done."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch

from diffprt.options.bake import BakeSettings
from diffprt.scene import Scene
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.inside import Fill
from diffprt.transfer.diffuse.picked import PickedReceivers, reflected_light
from diffprt.transfer.diffuse.tracing import Tracing
from diffprt.transfer.diffuse.transport import trace_transport

# Ray counts nearer than this are not told apart: between them the error is taken for a power law.
_BRACKET = 1.25
# Seeds of a truth are far from those of bakes and of their trials.
_OTHER_SEED = 0x5EED << 40


class Truth:
    """Transfer of (some of) a scene's receivers with many rays, independent of the bakes it is held against.

    With bounces the last one is gathered with `settings.rays`, and what it gathers is known from fewer rays where
    the operator of all receivers would be too large: each receiver averages over many others.

    Args:
        settings: `rays` are those of the truth.
        most_rays: over all receivers, once for the truth and once for what it gathers.

    Attributes:
        share: of the receivers, drawn at random, that are compared.
        reflection_rays: per receiver, for the light that the last bounce gathers; 0 without bounces.
    """

    def __init__(self, scene: Scene, settings: BakeSettings, *, most_rays: int) -> None:
        surfaces = Surfaces.of(scene)
        fill = Fill.of_surfaces(surfaces)
        every = surfaces.receivers
        size = max(1, min(len(every), most_rays // settings.rays))
        seed = settings.seed ^ _OTHER_SEED
        generator = torch.Generator().manual_seed(seed & 0x7FFFFFFFFFFFFFFF)
        self.pick = torch.randperm(len(every), generator=generator)[:size].sort().values
        self.share = size / len(every)
        self.reflection_rays = 0
        reflected = None
        if settings.reflects:
            self.reflection_rays = min(settings.rays, max(1, most_rays // len(every)))
            before = replace(settings, rays=self.reflection_rays, bounces=settings.bounces - 1, seed=seed + 1)
            transport = trace_transport(Tracing(surfaces, every, before), fill=fill)
            reflected = reflected_light(surfaces, transport.transfer().diffuse)
        picked = PickedReceivers(surfaces, self.pick, fill)

        def traced(rays: int, seed: int) -> torch.Tensor:
            return picked.trace(rays, seed, settings.order, reflected=reflected)[0]

        self._traced, self._seed = traced, settings.seed
        self.signal = traced(settings.rays, seed)

    def error_of(self, transfer: torch.Tensor) -> float:
        """Relative root mean square error of `transfer` [V, C, K]; 0 where there is no light at all."""
        return self._error(transfer[self.pick].detach().double())

    def error_with(self, rays: int) -> float:
        """The error that a fixed number of rays leaves.

        Only the receivers that are compared are traced, and they gather the light of the truth. A whole bake
        gathers light with noise of its own, so that the fixed setting comes out slightly too well.
        """
        return self._error(self._traced(rays, self._seed))

    def _error(self, signal: torch.Tensor) -> float:
        difference = float((signal - self.signal).square().sum(-1).mean())
        size = float(self.signal.square().sum(-1).mean())
        return 0.0 if difference == 0 else math.sqrt(difference / size) if size > 0 else math.inf


def fewest_rays(error_at: Callable[[int], float], tolerance: float, start: int, fewest: int) -> float:
    """The fewest fixed rays whose error is at most `tolerance`.

    Bracketed, then narrowed until neighbors are a quarter apart, between which the error is a power of the rays.

    Args:
        error_at: error of a bake with so many rays; falls, by and large.
        start: where to look first.
        fewest: the answer is not below.
    """
    low, low_error = fewest, error_at(fewest)
    if low_error <= tolerance:
        return float(fewest)
    high = max(start, fewest + 1)
    high_error = error_at(high)
    while high_error > tolerance:
        low, low_error = high, high_error
        high = 2 * high
        high_error = error_at(high)

    def crossing() -> float:
        if high_error == 0:
            return math.sqrt(low * high)
        share = math.log(low_error / tolerance) / math.log(low_error / high_error)
        return low * (high / low) ** share

    while high / low > _BRACKET:
        # A little inwards, so that both ends close in.
        middle = round(min(max(crossing(), 1.1 * low), high / 1.1))
        if not low < middle < high:
            break
        error = error_at(middle)
        if error > tolerance:
            low, low_error = middle, error
        else:
            high, high_error = middle, error
    return crossing()
