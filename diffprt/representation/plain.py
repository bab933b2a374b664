"""Plain values: what headers of files and lists of references hold, and what can be written as JSON and read again."""

from __future__ import annotations

import json
import math
from typing import Any, NoReturn

from diffprt.errors import InputError

DEEPEST = 32
_LARGEST_INTEGER = 1 << 64
_SHOWN = 60


def parse_plain(text: str | bytes, what: str, remedy: str) -> Any:
    """The plain value of a JSON text.

    Args:
        what: what it is of, for messages.
        remedy: what to do where it is none.

    Raises:
        InputError: no JSON, or as `check_plain`.
    """

    def refuse(constant: str) -> NoReturn:
        raise InputError(f"{what} holds {constant}, which is not finite: give finite numbers, or {remedy}")

    try:
        value = json.loads(text, parse_constant=refuse)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error).splitlines()[0][:_SHOWN]
        raise InputError(f"{what} is no JSON ({reason}): {remedy}") from error
    check_plain(value, what, remedy)
    return value


def check_plain(value: object, what: str, remedy: str) -> None:
    """Refuses what JSON would not give back as it is.

    Plain are None, truth values, whole numbers below 2^64, finite numbers, texts, and lists and dictionaries of them
    with texts as keys, at most 32 of them in each other.

    Raises:
        InputError: something is not.
    """
    level: list[tuple[str, object]] = [("", value)]
    depth = 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise InputError(f"{what} is nested more than {DEEPEST} deep: {remedy}")
        below: list[tuple[str, object]] = []
        for place, part in level:
            if isinstance(part, dict):
                for key, held in part.items():
                    if wrong := "a key that is no text" if type(key) is not str else _wrong(key):
                        raise InputError(f"{what} has {wrong}{place and f' in {place}'}: {remedy}")
                    below.append((_place(place, key), held))
            elif isinstance(part, list):
                below += [(place, held) for held in part]
            elif wrong := _wrong(part):
                raise InputError(f"{what} has {wrong}{place and f' as {place}'}: {remedy}")
        level = below


def _place(place: str, key: str) -> str:
    text = f"{place}.{key}" if place else key
    return ascii(text)[1:-1][:_SHOWN]


def _wrong(value: object) -> str | None:
    """Why a value that holds no others is not plain."""
    if value is None or isinstance(value, bool):
        return None
    if isinstance(value, int):
        return None if abs(value) <= _LARGEST_INTEGER else "a whole number beyond 2^64"
    if isinstance(value, float):
        return None if math.isfinite(value) else f"{float(value)}, no finite number"
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            return "a text that is no Unicode"
        return None
    return f"a {type(value).__name__}, which JSON would not give back"
