"""Values as users type them: colors, numbers, sizes."""

from __future__ import annotations

import math
import re

from diffprt.errors import InputError
from diffprt.options import CONVERGED
from diffprt.options.numbers import check_numbers

# Beyond these, arithmetic in 32 bits ends in infinity.
_LARGEST_COLOR, _LARGEST_NUMBER = 1e6, 1e9
_MOST_BYTES = 10**15
_BYTES = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9}


def parse_color(text: str, name: str) -> tuple[float, float, float]:
    """A number or three, separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(abs(v) <= _LARGEST_COLOR for v in values):
        raise InputError(f"{name} is '{text}': give one number or three, such as 0.8 or 0.8,0.7,0.6")
    red, green, blue = values * (3 // len(values))
    return red, green, blue


def parse_number(text: str, name: str) -> float:
    """One positive number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= _LARGEST_NUMBER:
        raise InputError(f"{name} is '{text}': give a positive number, at most {_LARGEST_NUMBER:g}")
    return value


def parse_point(text: str, name: str) -> tuple[float, float, float]:
    """Three coordinates, separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(math.isfinite(v) for v in values):
        raise InputError(f"{name} is '{text}': give three numbers, such as 0,0.5,0")
    x, y, z = values
    return x, y, z


def parse_size(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT or one side."""
    try:
        sides = [int(part) for part in text.lower().split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise InputError(f"size is '{text}': give pixels such as 512 or 640x480")
    for side in sides:
        check_numbers({"size": side})
    return sides[0], sides[-1]


def parse_bounces(text: str | None) -> int | str | None:
    """A number of bounces, or "converged"."""
    if text is None or text == CONVERGED:
        return text
    try:
        return int(text)
    except ValueError:
        raise InputError(f"bounces is '{text}': give 0 to 64, such as 2, or converged") from None


def parse_clusters(text: str) -> tuple[int, int]:
    """CLUSTERSxCOMPONENTS."""
    try:
        clusters, components = (int(part) for part in text.split("x"))
    except ValueError:
        raise InputError(f"size is '{text}': give CLUSTERSxCOMPONENTS such as 64x8") from None
    check_numbers({"clusters": clusters, "components": components})
    return clusters, components


def parse_bytes(text: str) -> int:
    """A number of bytes, with or without KB, MB or GB (powers of 1000)."""
    found = re.fullmatch(r"\s*([0-9.]+)\s*([KMG]?B?)\s*", text.upper())
    unit = "" if found is None else found[2].removesuffix("B") + "B" if found[2] not in ("", "B") else ""
    try:
        count = round(float(found[1]) * _BYTES[unit]) if found else 0
    except (ValueError, OverflowError):
        count = 0
    if not 1 <= count <= _MOST_BYTES:
        raise InputError(f"bytes is '{text}': give a size such as 500KB or 2MB")
    return count


def parse_budget(text: str | None) -> int | None:
    """A number of bytes, or None where no budget is given."""
    return None if text is None else parse_bytes(text)
