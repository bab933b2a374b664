"""How many rays an asked error, or an asked time, calls for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.scene import Scene
from diffprt.transfer.direct import DirectTracer, direct_transfer
from diffprt.transfer.estimate import estimate_bake
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.sampling import Pattern
from diffprt.transfer.settings import BakeSettings
from diffprt.transfer.surfaces import Surfaces

_FIRST_RAYS = 64
_FEWEST, _MOST = 32, 1 << 18
_LEAST_SAMPLE, _LARGEST_SAMPLE = 96, 1024
# A sample of receivers misjudges the error of all by some percent: aim this much below what was asked.
_MARGIN = 0.85
_SLOWEST_EXPONENT, _FASTEST_EXPONENT = 0.5, 1.0


@dataclass(frozen=True)
class SamplingRate:
    """A number of rays and why.

    Attributes:
        rays: per receiver.
        expected_error: relative root mean square error of the signal at that number.
        correction: what the noise that the halves of a bake show is to be multiplied by, to be its true error:
            stratified rays do better than two independent halves suggest.
        pilot_rays: rays traced to find out, over all receivers sampled.
        error_by_rays: relative error found at each number of rays tried.
    """

    rays: int
    expected_error: float
    correction: float
    pilot_rays: int
    error_by_rays: dict[int, float]

    def as_dict(self) -> dict:
        """Plain values."""
        return {
            "rays": self.rays,
            "expected_error": self.expected_error,
            "correction": self.correction,
            "pilot_rays": self.pilot_rays,
            "error_by_rays": {str(rays): error for rays, error in self.error_by_rays.items()},
        }


def rays_for_tolerance(
    scene: Scene, settings: BakeSettings, tolerance: float, *, threads: int | None = None
) -> SamplingRate:
    """The fewest rays whose relative root mean square error is expected to stay within `tolerance`.

    A sample of receivers is traced with 64, 256, 1024, ... rays. The difference of two steps is the error of the
    coarser one (the finer is about a third of it off, independently); its fall from step to step gives the rate at
    which this scene converges, between N^-1/2 (Monte Carlo) and N^-1.

    Args:
        tolerance: in (0, 1): root mean square error over receivers and coefficients, as a share of the signal's.

    Raises:
        InputError: the tolerance is out of range, or calls for more than 262144 rays.
    """
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance is {tolerance}: give a share between 0 and 1, such as 0.01")
    sample = _Sample(scene, settings, threads)
    errors: dict[int, float] = {}
    rays, exponent = _FIRST_RAYS, 0.75
    coarse, noise = sample.trace(rays)
    while True:
        fine, fine_noise = sample.trace(4 * rays)
        errors[rays] = float((coarse - fine).square().sum(-1).mean().sqrt()) / sample.signal(fine)
        correction = errors[rays] / noise if noise > 0 else 1.0
        if rays // 4 in errors and errors[rays] > 0:
            fall = math.log(errors[rays // 4] / errors[rays], 4)
            exponent = min(max(fall, _SLOWEST_EXPONENT), _FASTEST_EXPONENT)
        wanted = rays * (errors[rays] / (_MARGIN * tolerance)) ** (1 / exponent)
        if wanted <= 4 * rays or errors[rays] == 0:
            break
        rays, coarse, noise = 4 * rays, fine, fine_noise
        if 4 * rays > _MOST:
            raise InputError(
                f"tolerance {tolerance} calls for about {wanted:.3g} rays per receiver, {_MOST} is the limit: "
                f"give {tolerance * (wanted / _MOST) ** exponent:.2g} or more"
            )
    chosen = max(_FEWEST, 16 * math.ceil(wanted / 16))
    expected = errors[rays] * (rays / chosen) ** exponent
    return SamplingRate(chosen, expected, correction, sample.traced, errors)


def rays_for_seconds(
    scene: Scene, settings: BakeSettings, seconds: float, *, threads: int | None = None
) -> SamplingRate:
    """The most rays that fit into `seconds` of baking on this machine; expected error from the same trial.

    Raises:
        InputError: the time is not positive, or too short for 32 rays.
    """
    if not 0 < seconds < math.inf:
        raise InputError(f"seconds is {seconds}: give a positive time, such as 20")
    low, high = (estimate_bake(scene, replace(settings, rays=rays), threads=threads).seconds for rays in (256, 4096))
    per_ray = max((high - low) / (4096 - 256), 1e-12)
    fixed = max(low - 256 * per_ray, 0.0)
    affordable = (0.9 * seconds - fixed) / per_ray
    if affordable < _FEWEST:
        raise InputError(
            f"{seconds:g} seconds are too short: {_FEWEST} rays take about {fixed + _FEWEST * per_ray:.2g} s here, "
            "give more time or a coarser mesh"
        )
    chosen = min(16 * int(affordable // 16), _MOST)
    sample = _Sample(scene, settings, threads)
    coarse, noise = sample.trace(_FIRST_RAYS)
    fine, _ = sample.trace(4 * _FIRST_RAYS)
    error = float((coarse - fine).square().sum(-1).mean().sqrt()) / sample.signal(fine)
    expected = error * (_FIRST_RAYS / chosen) ** 0.75
    correction = error / noise if noise > 0 else 1.0
    return SamplingRate(chosen, expected, correction, sample.traced, {_FIRST_RAYS: error})


def choose_rays(
    scene: Scene,
    settings: BakeSettings,
    *,
    rays: int | None = None,
    tolerance: float | None = None,
    seconds: float | None = None,
    threads: int | None = None,
) -> tuple[BakeSettings, SamplingRate | None]:
    """The settings with the rays that a tolerance or a time calls for; as they are where neither is given.

    Raises:
        InputError: more than one of rays, tolerance and seconds is given, or one is out of range.
    """
    given = [
        name for name, value in (("rays", rays), ("tolerance", tolerance), ("seconds", seconds)) if value is not None
    ]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} were given together: give one of them")
    if tolerance is not None:
        rate = rays_for_tolerance(scene, settings, tolerance, threads=threads)
    elif seconds is not None:
        rate = rays_for_seconds(scene, settings, seconds, threads=threads)
    else:
        return settings, None
    return replace(settings, rays=rate.rays), rate


class _Sample:
    """Receivers drawn at random (by the seed) for trial traces of the direct part."""

    def __init__(self, scene: Scene, settings: BakeSettings, threads: int | None) -> None:
        self.surfaces = Surfaces.of(scene)
        self.mesh = TriangleMesh(self.surfaces.positions, self.surfaces.faces)
        self.settings, self.threads, self.traced = settings, threads, 0
        every = self.surfaces.receivers
        size = min(max(len(every) // 64, _LEAST_SAMPLE), _LARGEST_SAMPLE, len(every))
        generator = torch.Generator().manual_seed(settings.seed & 0x7FFFFFFFFFFFFFFF)
        pick = torch.randperm(len(every), generator=generator)[:size].sort().values
        empty = torch.zeros((0, 3), dtype=torch.int64)
        self.receivers = Receivers(every.positions[pick], every.normals[pick], every.albedo[pick], empty)
        low = self.surfaces.positions.amin(0)
        self.scramble = self.receivers.scramble(settings.seed, low, self.surfaces.diagonal)

    def trace(self, rays: int) -> tuple[torch.Tensor, float]:
        """Direct transfer float64 [S, K] of the sample, and the relative noise that its halves show."""
        pattern = Pattern.create(rays, self.scramble ^ rays)
        tracer = DirectTracer(self.mesh, self.receivers, pattern, self.settings.order, None, 0)
        parts: dict[int, tuple] = {}

        def work(chunk: int) -> None:
            parts[chunk] = tracer.trace(chunk)

        for _ in run_chunks(work, range(tracer.chunks), threads=self.threads):
            pass
        self.traced += rays * len(self.receivers)
        sums = torch.cat([torch.from_numpy(parts[chunk][0]) for chunk in range(tracer.chunks)], dim=1)
        blocked = torch.cat([torch.from_numpy(parts[chunk][1]) for chunk in range(tracer.chunks)])
        transfer, error = direct_transfer(self.receivers.normals, sums, blocked, rays)
        transfer = transfer[:, 0].double()
        return transfer, float(error.double().square().sum(-1).mean().sqrt()) / self.signal(transfer)

    @staticmethod
    def signal(transfer: torch.Tensor) -> float:
        """Root mean square over receivers of the length of `transfer` [S, K]; never zero."""
        return float(transfer.square().sum(-1).mean().sqrt()) or 1.0
