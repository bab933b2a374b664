"""How many rays an asked error calls for, and what error rays leave."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings, check_tolerance
from diffprt.scene import Scene
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.deadline import FEWEST_RAYS, MOST_RAYS
from diffprt.transfer.baking.trial import Trial, TrialReceivers
from diffprt.transfer.diffuse.inside import Fill

_PACKET = 16
# Standard errors of a sample of receivers that a forecast allows for, and the share of a tolerance that it aims at:
# a sample's own standard error misses the rarest receivers, and the bake draws other rays.
_ALLOWED, _MARGIN = 2.0, 0.91
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
        exponent: the error falls like rays ** -exponent.
    """

    rays: int
    expected_error: float
    correction: float
    pilot_rays: int
    error_by_rays: dict[int, float]
    exponent: float = _EXPONENT

    def expected_with(self, rays: torch.Tensor | float) -> float:
        """The error to expect at most where receivers have those `rays`, [V] or the same for all."""
        shares = torch.as_tensor(rays, dtype=torch.float64) / self.rays
        return self.expected_error * float((shares ** (-2 * self.exponent)).mean().sqrt())

    def promised(self, certificate: dict, rays: torch.Tensor | None) -> dict:
        """What a certificate says of errors: `expected_error`, and `estimated_error` from the noise that it has.

        Args:
            certificate: of the bake.
            rays: [V], traced from each receiver; as many as these, without it.
        """
        others = rays is not None and bool((rays != self.rays).any())
        promised = {"expected_error": self.expected_with(rays.double()) if others else self.expected_error}
        if "noise_relative" in certificate:
            estimate = certificate["noise_relative"] * self.correction
            # The correction holds for these rays alone.
            promised["estimated_error"] = max(estimate, promised["expected_error"]) if others else estimate
        return promised

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
    scene: Scene, settings: BakeSettings, tolerance: float, *, threads: int | None = None, fill_inside: bool = True
) -> SamplingRate:
    """The fewest rays whose relative root mean square error is expected to stay within `tolerance`.

    A random sample of receivers is traced twice with 32 rays, then with as many as those suggest, until trials reach
    what is wanted; half the mean square difference of the two is the square of the error of one. The fall from
    trial to trial is the rate at which this scene converges, between N^-1/2 (Monte Carlo) and N^-1. With bounces,
    trials gather what all receivers reflect, known from a few rays each: interreflection adds more to the signal
    than to its noise. Receivers inside geometry are filled as the bake fills them.

    Args:
        tolerance: in (0, 1): root mean square error over receivers and coefficients, as a share of the signal's.
        fill_inside: as in `bake`.

    Raises:
        InputError: the tolerance is out of range, or calls for more than 262144 rays.
    """
    surfaces = Surfaces.of(scene)
    fill = Fill.of_surfaces(surfaces, threads) if fill_inside else None
    return rate_for_tolerance(TrialReceivers(surfaces, settings, fill, threads), tolerance)


def rate_for_tolerance(sample: TrialReceivers, tolerance: float) -> SamplingRate:
    """`rays_for_tolerance`, by trials of a sample."""
    check_tolerance(tolerance)
    trials = {FEWEST_RAYS: sample.measure(FEWEST_RAYS)}
    # Without any error every trial receiver is open or in the dark: none of them sees a surface that is lit.
    if sample.settings.reflects and trials[FEWEST_RAYS].error > 0:
        sample.see_reflections(_rays_for_reflections(_Forecast(trials).rays_for(_MARGIN * tolerance)))
        trials[FEWEST_RAYS] = sample.measure(FEWEST_RAYS)
    while True:
        forecast = _Forecast(trials)
        wanted = forecast.rays_for(_MARGIN * tolerance)
        if wanted <= _REACH * forecast.rays:
            break
        if wanted > MOST_RAYS and (forecast.measured or forecast.rays * _STEP > MOST_RAYS):
            raise InputError(
                f"tolerance {tolerance} calls for about {wanted:.3g} rays per receiver, {MOST_RAYS} is the limit: "
                f"give {forecast.error(MOST_RAYS) / _MARGIN:.2g} or more"
            )
        rays = _in_packets(min(wanted, _STEP * forecast.rays))
        trials[rays] = sample.measure(rays)
    return _rate(max(FEWEST_RAYS, _in_packets(wanted)), forecast, sample, trials)


def rate_of(sample: TrialReceivers, rays: int) -> SamplingRate:
    """What error a number of rays leaves, by trials with fewer of them."""
    if sample.settings.reflects:
        sample.see_reflections(_rays_for_reflections(rays))
    tried = sorted({FEWEST_RAYS, min(_STEP * FEWEST_RAYS, rays)})
    trials = {count: sample.measure(count) for count in tried}
    return _rate(rays, _Forecast(trials), sample, trials)


def rays_of_trials(sample: TrialReceivers, rays: int) -> int:
    """Rays that `rate_of` traces, over all receivers."""
    tried = sum({FEWEST_RAYS, min(_STEP * FEWEST_RAYS, rays)})
    own = sample.reflection_rays(_rays_for_reflections(rays)) if sample.settings.reflects else 0
    return own + sample.traced_at_a_time * (2 * tried + rays)


class _Forecast:
    """The error at numbers of rays that were not tried: a power law through the last trials.

    Attributes:
        rays: of the last trial.
        measured: whether two trials tell the exponent.
        exponent: of the power law.
    """

    def __init__(self, trials: dict[int, Trial]) -> None:
        self.rays = max(trials)
        self.trial = trials[self.rays]
        # Two standard errors above what was found, in 19 of 20 samples.
        self._bound = self.trial.error * (1 + _ALLOWED * self.trial.uncertainty)
        # Trials close to each other tell little of the exponent.
        before = max((rays for rays in trials if 2 * rays <= self.rays), default=None)
        self.measured = before is not None
        self.exponent = _EXPONENT
        if self.measured and min(self.trial.error, trials[before].error) > 0:
            fall = math.log(trials[before].error / self.trial.error) / math.log(self.rays / before)
            self.exponent = min(max(fall, _SLOWEST_EXPONENT), _FASTEST_EXPONENT)

    def error(self, rays: int) -> float:
        """The relative error to expect at most."""
        return self._bound * (self.rays / rays) ** self.exponent

    def rays_for(self, tolerance: float) -> float:
        """Where `error` falls to `tolerance`."""
        return self.rays * (self._bound / tolerance) ** (1 / self.exponent)


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
        chosen,
        expected,
        correction,
        sample.traced,
        {rays: trial.error for rays, trial in trials.items()},
        forecast.exponent,
    )
