"""How long a run lasts, and how its learning rate falls on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

from diffprt.errors import InputError

# Steps of a run that ends by its error or its clock.
_MOST_STEPS = 100_000
_STEPS = 300
# What the learning rate ends at, as a share: the last steps settle.
_LAST = 0.01


@dataclass(frozen=True)
class Schedule:
    """Ends a run after `steps`, after `seconds`, or when the held-out error reaches `tolerance`.

    Attributes:
        steps: at most this many.
        seconds: about this long; without, until the steps are done.
        tolerance: relative RMSE of held-out pictures that is good enough; without, as low as it gets.
    """

    steps: int
    seconds: float | None = None
    tolerance: float | None = None

    @staticmethod
    def of(steps: int | None, seconds: float | None, tolerance: float | None) -> Schedule:
        """Checks the options; `steps` is 300 unless `seconds` is given.

        Raises:
            InputError: one of them is out of range.
        """
        if steps is not None and not 1 <= steps <= _MOST_STEPS:
            raise InputError(f"steps is {steps}: give 1 to {_MOST_STEPS}, such as {_STEPS}")
        if seconds is not None and not 0 < seconds <= 1e9:
            raise InputError(f"seconds is {seconds}: give a number above 0, such as 30")
        if tolerance is not None and not 0 < tolerance < 1:
            raise InputError(f"tolerance is {tolerance}: give a relative error between 0 and 1, such as 0.01")
        return Schedule(steps or (_STEPS if seconds is None else _MOST_STEPS), seconds, tolerance)

    def rate(self, step: int, elapsed: float) -> float:
        """Share of the learning rate: half a cosine over the run (Loshchilov and Hutter 2017)."""
        done = step / self.steps if self.seconds is None else min(1.0, elapsed / self.seconds)
        return _LAST + (1 - _LAST) * (1 + math.cos(math.pi * done)) / 2

    def over(self, step: int, elapsed: float) -> bool:
        """Whether no step is left."""
        return step >= self.steps or (self.seconds is not None and elapsed >= self.seconds)
