"""Rays of a diffuse bake that has to end in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings
from diffprt.surface.receivers import Receivers
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.deadline import AIM, FEWEST_RAYS, Cost, Deadline, Pace
from diffprt.transfer.baking.estimate import fits
from diffprt.transfer.baking.job import JobOptions
from diffprt.transfer.baking.sampling_rate import SamplingRate, rate_of, rays_of_trials
from diffprt.transfer.baking.trial import TrialReceivers
from diffprt.transfer.diffuse.cost import measured_cost
from diffprt.transfer.diffuse.estimate import diffuse_memory

# Share of the time left that trials of the error may take; where they would take more, the certificate does without.
_TRIALS = 0.12
# The least that is named is that much more than was measured: the next start may take longer.
_ALLOWED = 1.1
# Share of the free memory that a stored operator may take: the clock may find time for more rays than were planned.
_MEMORY = 0.5


@dataclass(frozen=True)
class TimedRate:
    """What is to be done in the time.

    Attributes:
        rays: per receiver, if the machine stays as fast as it is.
        operator: "stored" or "recompute".
        sampling: the error to expect; None where there is no time to find out.
        cost: of rays, for the clock.
        threads: CPU threads.
        own, given: sides of the scene's own receivers that are traced, and of free ones.
    """

    rays: int
    operator: str
    sampling: SamplingRate | None
    cost: Cost
    threads: int
    own: int
    given: int

    def pace(self, deadline: Deadline, receivers: Receivers | None) -> Pace:
        """Of the pass over free `receivers`, or over the scene's own, which comes before."""
        if receivers is None:
            cost = self.cost.then(self.given) if self.given else self.cost
            return Pace(deadline, cost, self.own, self.rays, self.threads)
        return Pace(deadline, self.cost, self.given, self.rays, self.threads)


def timed_rate(
    deadline: Deadline,
    surfaces: Surfaces,
    options: JobOptions,
    asked: BakeSettings,
    sample: TrialReceivers,
    threads: int,
) -> TimedRate:
    """Measures what rays cost, refuses what cannot end in time, and finds the error to expect.

    Raises:
        InputError: the fewest rays do not fit.
    """
    free = options.receivers
    given = 0 if free is None else free.sides
    own = surfaces.receivers.sides if free is None or asked.reflects else 0
    measured = surfaces.receivers if own else free
    operator = "recompute" if options.operator == "recompute" else "stored"

    def fit(cost: Cost) -> int:
        return cost.affordable(own + given, deadline)

    cost, entries = measured_cost(surfaces, measured, asked, threads, stored=operator == "stored", fit=fit)
    rays = fit(cost)
    if options.operator == "auto" and asked.reflects and rays:
        needed = measured.sides * min(int(entries * rays), len(surfaces.receivers))
        if not fits(diffuse_memory(surfaces, measured, asked, needed, "stored", threads), _MEMORY):
            operator = "recompute"
            cost, _ = measured_cost(surfaces, measured, asked, threads, stored=False, fit=fit)
            rays = fit(cost)
    if rays == 0:
        least = cost.least(own + given, deadline)
        raise InputError(
            f"{deadline.seconds:g} seconds are too short: {deadline.spent:.2g} s have gone to the start, and the "
            f"fewest rays, {FEWEST_RAYS}, take {cost.whole(own + given, FEWEST_RAYS):.2g} s here: "
            f"give at least {_rounded_up(_ALLOWED * least):g} seconds, fewer bounces or a coarser mesh"
        )
    sampling = None
    lasting = cost.ray * rays_of_trials(sample, rays)
    if lasting <= _TRIALS * deadline.until(AIM):
        rays = cost.most_rays(own + given, deadline.until(AIM) - lasting) or rays
        sampling = rate_of(sample, rays)
    return TimedRate(rays, operator, sampling, cost, threads, own, given)


def _rounded_up(seconds: float) -> float:
    """To two digits."""
    step = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return round(math.ceil(seconds / step) * step, 6)
