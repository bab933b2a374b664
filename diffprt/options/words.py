"""The words that options of several commands take, by the option's name: known before anything is loaded."""

from __future__ import annotations

from collections.abc import Mapping

from diffprt.options.export import CURVES
from diffprt.options.ranges import check_choice
from diffprt.options.view import WINDOWS

NON_FINITE = ("refuse", "drop")
WINDINGS = ("repair", "keep")
UP_AXES = ("y", "-y", "z", "-z", "x", "-x")

WORDS: dict[str, tuple[str, ...]] = {
    "curve": CURVES,
    "window": WINDOWS,
    "non_finite": NON_FINITE,
    "winding": WINDINGS,
    "up": UP_AXES,
}


def check_words(given: Mapping[str, object]) -> None:
    """Refuses words that an option of that name does not take; what has no list, or is not given, is left to others.

    Raises:
        InputError: names the words that it takes.
    """
    for name, value in given.items():
        if name in WORDS and isinstance(value, str):
            check_choice(name, value, WORDS[name])
