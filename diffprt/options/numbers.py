"""The numbers that anything can be told, by name, each with its range: in Python, and on the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral, Real

from diffprt.errors import InputError

_MOST_SHOWN = 24


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`; NaN and infinity are in no range.

    Attributes:
        wanted: what to give instead, in words.
        above, below: whether `low` and `high` themselves are left out.
        whole: whether only whole numbers are in it.
        said: the message about a `value` of option `name`.
    """

    low: float
    high: float
    wanted: str
    above: bool = False
    below: bool = False
    whole: bool = False
    said: str = "{name} is {value}: give {wanted}"

    def holds(self, value: Real | float) -> bool:
        """Whether a number is in it."""
        if self.whole and not isinstance(value, Integral):
            return False
        # Whole numbers of any length compare with floats; what turns them into floats overflows.
        if not isinstance(value, Integral) and not math.isfinite(value):
            return False
        over = value > self.low if self.above else value >= self.low
        return bool(over and (value < self.high if self.below else value <= self.high))


def whole(low: int, high: int, such_as: int | str) -> Range:
    """Whole numbers from `low` to `high`."""
    return Range(low, high, f"{low} to {high}, such as {such_as}", whole=True)


def _degrees(such_as: str) -> Range:
    return Range(-36000, 36000, f"degrees, such as {such_as}")


def _positive(high: float, what: str) -> Range:
    return Range(0, high, what, above=True)


_COUNT = whole(1, 100_000, 24)
_SIDE = whole(1, 16384, 512)
_BANDS = Range(1, 10, "1 to 10", whole=True, said="order {value} is outside 1..10: give {name}=1 to {name}=10")
_RAYS = whole(1, 1 << 20, 1024)
_ROUNDS = whole(1, 10_000, 5)
_SHARE = _positive(1, "a share between 0 and 1, such as 0.01")
_WEIGHT = Range(0, 1e6, "0 or more, at most 1e6, such as 0.5")

# An option of this name has this range wherever it stands; a function may take less, and says so itself.
NUMBERS: dict[str, Range] = {
    "albedo_views": _COUNT,
    "azimuth": _degrees("25"),
    "batch": whole(1, 4096, 4),
    "bounce_rays": _RAYS,
    "bounces": whole(0, 64, 2),
    "brute_tests": Range(0, 1e15, "0 to 1e15, such as 1e10"),
    "budgets": whole(1, 1 << 20, 256),
    "channels": whole(1, 3, "1 or 3"),
    "clusters": whole(1, 65536, 64),
    "coherence": _WEIGHT,
    "components": whole(0, 4096, 8),
    "count": _COUNT,
    "distance": _positive(1e9, "a positive distance in scene units, such as 3"),
    "elevation": _degrees("15"),
    "exposure": _positive(1e9, "a positive factor, at most 1e9, such as 1"),
    "finer_rays": _RAYS,
    "fov": Range(0, 180, "degrees between 0 and 180, such as 35", above=True, below=True),
    "frames": _ROUNDS,
    "geometry": Range(16, 32, "16 or 32", whole=True),
    "halves": whole(2, 64, 2),
    "held_out": Range(0, 1, "a share from 0 up to 1, such as 0.2", below=True),
    "hours": _positive(1e6, "a positive time, such as 1"),
    "iterations": whole(1, 100_000, 50),
    "large": whole(0, 1 << 27, 1_500_000),
    "learning_rate": _positive(1, "a number above 0 and at most 1, such as 0.05"),
    "light_azimuth": _degrees("90"),
    "minutes": Range(0, 1e6, "0 or more, such as 30"),
    "noise": _positive(1, "a positive share, such as 0.01"),
    "order": _BANDS,
    "order_out": _BANDS,
    "per_pass": whole(1, 1 << 20, 8),
    "pictures": _COUNT,
    "pixels": _SIDE,
    "random": whole(0, 100_000, 12),
    "rays": _RAYS,
    "reference_set": _COUNT,
    "registers": whole(1, 1 << 20, 256),
    "ridge": Range(0, 1e6, "0 or more, such as 3e-4"),
    "rounds": _ROUNDS,
    "rows": whole(2, 4096, 32),
    "runs": _ROUNDS,
    "samples": whole(1, 1 << 20, 2),
    "seconds": _positive(1e9, "a positive time, such as 20"),
    "seed": Range(0, 2**64 - 1, "a non-negative integer below 2^64", whole=True),
    "seeds": whole(1, 1000, 3),
    "size": _SIDE,
    "slack": Range(0, 1e6, "0 or more, such as 0.1"),
    "steps": whole(1, 100_000, 300),
    "test_rays": whole(1, 1 << 30, 1_000_000),
    "threads": Range(1, 4096, "1 or more, at most 4096, or leave it out to use all", whole=True),
    "tolerance": _SHARE,
    "tolerances": _SHARE,
    "turns": _degrees("72"),
    "truth_rays": whole(1, 10**12, 20_000_000),
    "truth_samples": whole(1, 1 << 20, 1024),
    "variation": _positive(1e6, "a positive share, such as 0.05"),
    "views": _COUNT,
}


def check_numbers(given: Mapping[str, object], *, absurd: bool = False) -> None:
    """Refuses numbers outside their ranges; what is no number, or has no range, is left to others.

    Args:
        given: values by name, numbers or sequences of them among others.
        absurd: only refuses what is not finite or too large; what is too small is left to others.

    Raises:
        InputError: a number is NaN, infinite, or out of range.
    """
    for name, value in given.items():
        one = [value] if isinstance(value, Real) else value if isinstance(value, list | tuple) else []
        for number in one:
            known = NUMBERS.get(name)
            if known is None or isinstance(number, bool) or not isinstance(number, Real) or known.holds(number):
                continue
            if not absurd or not number <= known.high:
                raise InputError(known.said.format(name=name, value=number_text(number), wanted=known.wanted))


def number_text(value: Real | float) -> str:
    """A number as it was given; of a very long one, how long it is."""
    if isinstance(value, Integral) and abs(value) >= 10**_MOST_SHOWN:
        return f"a number of about {round(int(value).bit_length() * math.log10(2))} digits"
    return str(value)
