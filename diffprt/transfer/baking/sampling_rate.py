"""How many rays an asked error, or an asked time, calls for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.options.bake import BakeSettings, check_tolerance
from diffprt.scene import Scene
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.trial import Trial, TrialReceivers
from diffprt.transfer.diffuse.estimate import estimate_diffuse

_FEWEST, _MOST = 32, 1 << 18
_PACKET = 16
# Standard errors of a sample of receivers that a forecast allows for, and the share of a tolerance that it aims at:
# a sample's own standard error misses the rarest receivers, and the bake draws other rays.
_ALLOWED, _MARGIN = 2.0, 0.93
# Between random and perfectly stratified rays; the middle until two trials tell.
_SLOWEST_EXPONENT, _EXPONENT, _FASTEST_EXPONENT = 0.5, 0.75, 1.0
# Trials reach at most this much farther at a time, and a forecast this much beyond the last of them.
_STEP, _REACH = 8, 1.5
# Share of the rays of a bake that its trials spend on what surfaces reflect.
_REFLECTION_SHARE, _FEWEST_FOR_REFLECTIONS, _MOST_FOR_REFLECTIONS = 1 / 16, 8, 64


@dataclass(frozen=True)
class SamplingRate:
    """A number of rays and why.

    Attributes:
        rays: per receiver.
        expected_error: relative root mean square error of the signal to expect at most, two standard errors of
            the trials included.
        correction: what the noise that the halves of a bake show is to be multiplied by, to be its true error:
            stratified rays do better than two independent halves suggest. Two standard errors are included.
        pilot_rays: rays traced to find out, over all receivers.
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

    A random sample of receivers is traced twice with 32 rays, then with as many as those suggest, until trials reach
    what is wanted; half the mean square difference of the two is the square of the error of one. The fall from
    trial to trial is the rate at which this scene converges, between N^-1/2 (Monte Carlo) and N^-1. With bounces,
    trials gather what all receivers reflect, known from a few rays each: interreflection adds more to the signal
    than to its noise.

    Args:
        tolerance: in (0, 1): root mean square error over receivers and coefficients, as a share of the signal's.

    Raises:
        InputError: the tolerance is out of range, or calls for more than 262144 rays.
    """
    check_tolerance(tolerance)
    sample = TrialReceivers(scene, settings, threads)
    trials = {_FEWEST: sample.measure(_FEWEST)}
    # Without any error every trial receiver is open or in the dark: none of them sees a surface that is lit.
    if settings.reflects and trials[_FEWEST].error > 0:
        sample.see_reflections(_rays_for_reflections(_Forecast(trials).rays_for(_MARGIN * tolerance)))
        trials[_FEWEST] = sample.measure(_FEWEST)
    while True:
        forecast = _Forecast(trials)
        wanted = forecast.rays_for(_MARGIN * tolerance)
        if wanted <= _REACH * forecast.rays:
            break
        if wanted > _MOST and (forecast.measured or forecast.rays * _STEP > _MOST):
            raise InputError(
                f"tolerance {tolerance} calls for about {wanted:.3g} rays per receiver, {_MOST} is the limit: "
                f"give {forecast.error(_MOST) / _MARGIN:.2g} or more"
            )
        rays = _in_packets(min(wanted, _STEP * forecast.rays))
        trials[rays] = sample.measure(rays)
    chosen = max(_FEWEST, _in_packets(wanted))
    return _rate(chosen, forecast, sample, trials)


def rays_for_seconds(
    scene: Scene, settings: BakeSettings, seconds: float, *, threads: int | None = None
) -> SamplingRate:
    """The most rays that fit into `seconds` of baking on this machine; expected error from the same trial.

    Raises:
        InputError: the time is too short for 32 rays.
    """
    surfaces, threads = Surfaces.of(scene), threads or default_threads()
    low, high = (
        estimate_diffuse(surfaces, surfaces.receivers, replace(settings, rays=rays), "auto", threads).seconds
        for rays in (256, 4096)
    )
    per_ray = max((high - low) / (4096 - 256), 1e-12)
    fixed = max(low - 256 * per_ray, 0.0)
    affordable = (0.9 * seconds - fixed) / per_ray
    if affordable < _FEWEST:
        raise InputError(
            f"{seconds:g} seconds are too short: {_FEWEST} rays take about {fixed + _FEWEST * per_ray:.2g} s here, "
            "give more time or a coarser mesh"
        )
    chosen = min(_PACKET * int(affordable // _PACKET), _MOST)
    sample = TrialReceivers(scene, settings, threads)
    if settings.reflects:
        sample.see_reflections(_rays_for_reflections(chosen))
    trials = {rays: sample.measure(rays) for rays in (_FEWEST, _STEP * _FEWEST)}
    return _rate(chosen, _Forecast(trials), sample, trials)


class _Forecast:
    """The error at numbers of rays that were not tried: a power law through the last trials.

    Attributes:
        rays: of the last trial.
        measured: whether two trials tell the exponent.
    """

    def __init__(self, trials: dict[int, Trial]) -> None:
        self.rays = max(trials)
        self.trial = trials[self.rays]
        # Two standard errors above what was found, in 19 of 20 samples.
        self._bound = self.trial.error * (1 + _ALLOWED * self.trial.uncertainty)
        # Trials close to each other tell little of the exponent.
        before = max((rays for rays in trials if 2 * rays <= self.rays), default=None)
        self.measured = before is not None
        self._exponent = _EXPONENT
        if self.measured and min(self.trial.error, trials[before].error) > 0:
            fall = math.log(trials[before].error / self.trial.error) / math.log(self.rays / before)
            self._exponent = min(max(fall, _SLOWEST_EXPONENT), _FASTEST_EXPONENT)

    def error(self, rays: int) -> float:
        """The relative error to expect at most."""
        return self._bound * (self.rays / rays) ** self._exponent

    def rays_for(self, tolerance: float) -> float:
        """Where `error` falls to `tolerance`."""
        return self.rays * (self._bound / tolerance) ** (1 / self._exponent)


def _rays_for_reflections(rays: float) -> int:
    return int(min(max(_REFLECTION_SHARE * rays, _FEWEST_FOR_REFLECTIONS), _MOST_FOR_REFLECTIONS))


def _in_packets(rays: float) -> int:
    """Rays are traced in packets: the last one is filled."""
    return _PACKET * math.ceil(rays / _PACKET)


def _rate(chosen: int, forecast: _Forecast, sample: TrialReceivers, trials: dict[int, Trial]) -> SamplingRate:
    """The noise of halves jumps from one number of rays to the next, the error does not: noise needs a trace."""
    trial, expected = forecast.trial, forecast.error(chosen)
    correction = 1.0
    if trial.error > 0 and (noise := sample.noise(chosen)) > 0:
        likely = expected / (1 + _ALLOWED * trial.uncertainty)
        correction = likely / noise * (1 + _ALLOWED * trial.noise_uncertainty)
    return SamplingRate(
        chosen, expected, correction, sample.traced, {rays: trial.error for rays, trial in trials.items()}
    )
