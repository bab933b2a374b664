"""Ranges that several operations share."""

from __future__ import annotations

import operator

from diffprt.errors import InputError
from diffprt.options.numbers import check_numbers, number_text

MAXIMUM_ORDER = 10


def check_order(order: int, *, most: int = MAXIMUM_ORDER) -> int:
    """`order` as a plain int in 1..`most`.

    Raises:
        InputError: `order` is not a whole number or lies outside 1..`most`.
    """
    try:
        whole = operator.index(order)
    except TypeError:
        raise InputError(f"order {order!r} is not a whole number: give order=1 to order={most}") from None
    if not 1 <= whole <= most:
        raise InputError(f"order {number_text(whole)} is outside 1..{most}: give order=1 to order={most}")
    return whole


def check_choice(what: str, value: str, choices: tuple[str, ...] | dict[str, object]) -> None:
    """Refuses a `value` that is not among `choices`."""
    if value not in choices:
        raise InputError(f"{what} is '{value}': use one of {', '.join(choices)}")


def check_threads(threads: int | None) -> None:
    """Refuses a number of CPU threads below 1; None is all."""
    check_numbers({"threads": threads})


def check_geometry(bits: int | None) -> None:
    """Refuses geometry in other than 32 or 16 bits; None is left to the operation."""
    if bits not in (None, 32, 16):
        raise InputError(f"geometry is {bits}: give 32, or 16 for positions and normals in 16 bits")
