"""What `references.json` holds: read, and checked in shape, type and range before anything is made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from diffprt import sh
from diffprt.errors import InputError
from diffprt.representation.plain import parse_plain
from diffprt.scene import Camera

VERSION = 1
MOST = 100_000
MOST_SAMPLES = 16
_LARGEST_FILE = 1 << 30
_LONGEST_NAME, _LONGEST_HASH = 255, 128
# Beyond these, squares of single floats overflow.
_FARTHEST = 1e18
_REMEDY = "make them again"
_SHOWN = 60


@dataclass(frozen=True)
class Row:
    """One picture: the name of its file, its camera, and the coefficients of its light, [K][3]."""

    image: str
    camera: Camera
    light: list[list[float]]


@dataclass(frozen=True)
class Listing:
    """All of the file; attributes as of `References`."""

    rows: tuple[Row, ...]
    scene_hash: str
    bounds: tuple[tuple[float, ...], ...]
    samples: int


def parse_listing(text: bytes, what: str) -> Listing:
    """The content of a `references.json`.

    Args:
        what: what it is, for messages.

    Raises:
        InputError: it is none: no JSON, of another version, or with an entry of another type, shape or range.
    """
    if len(text) > _LARGEST_FILE:
        raise InputError(f"{what} has {len(text)} bytes, at most {_LARGEST_FILE} are read: {_REMEDY}")
    content = parse_plain(text, f"{what} is damaged: it", _REMEDY)
    version = content.get("version") if isinstance(content, dict) else None
    if type(version) is int and version != VERSION:
        raise InputError(f"{what} has version {version}, this diffprt reads {VERSION}: {_REMEDY}")
    try:
        if type(version) is not int:
            raise InputError("it has no version")
        rows = content.get("references")
        if not isinstance(rows, list):
            raise InputError(f"references is {_told(rows)}, wanted a list")
        if not 1 <= len(rows) <= MOST:
            raise InputError(f"it lists {len(rows)} pictures, wanted 1 to {MOST}")
        bounds = content.get("bounds", [])
        scene_hash = content.get("scene_hash", "")
        check_scene_hash(scene_hash)
        corners = (
            () if bounds == [] else tuple(_numbers(c, 3, "a corner of bounds") for c in _list(bounds, 2, "bounds"))
        )
        samples = _whole(content.get("samples", 1), 1, MOST_SAMPLES, "samples")
        return Listing(tuple(_row(row, index) for index, row in enumerate(rows)), scene_hash, corners, samples)
    except InputError as error:
        raise InputError(f"{what} is damaged: {error}; {_REMEDY}") from error


def check_scene_hash(value: object) -> None:
    """Raises InputError where it is no short text."""
    if not isinstance(value, str) or len(value) > _LONGEST_HASH or not value.isprintable():
        raise InputError(f"scene_hash is {_told(value)}, wanted at most {_LONGEST_HASH} printable characters")


def _row(row: object, index: int) -> Row:
    if not isinstance(row, dict):
        raise InputError(f"picture {index} is {_told(row)}, wanted an object")
    try:
        camera, light = row.get("camera"), row.get("light")
        if not isinstance(camera, dict):
            raise InputError(f"camera is {_told(camera)}, wanted an object")
        return Row(
            _name(row.get("image")),
            Camera(
                eye=_vector(camera.get("eye"), "eye"),
                target=_vector(camera.get("target"), "target"),
                up=_vector(camera.get("up"), "up"),
                fov=_number(camera.get("fov"), 180.0, "fov"),
                width=_whole(camera.get("width"), 1, 16384, "width"),
                height=_whole(camera.get("height"), 1, 16384, "height"),
            ),
            _light(light),
        )
    except InputError as error:
        raise InputError(f"picture {index}: {error}") from error


def _name(value: object) -> str:
    """The name of a file beside the list."""
    if not (isinstance(value, str) and value.isprintable() and 1 <= len(value.encode()) <= _LONGEST_NAME):
        raise InputError(f"image is {_told(value)}, wanted the name of a file, at most {_LONGEST_NAME} bytes")
    if value in (".", "..") or "/" in value or "\\" in value:
        raise InputError(f"image '{value[:_SHOWN]}' is outside its folder, wanted a name without folders")
    return value


def _light(value: object) -> list[list[float]]:
    if not isinstance(value, list):
        raise InputError(f"light is {_told(value)}: give coefficients [order², 3]")
    sh.order_of_count(len(value))
    try:
        return [list(_numbers(coefficient, 3, "one of light")) for coefficient in value]
    except InputError as error:
        raise InputError(f"{error}: give coefficients [order², 3]") from error


def _vector(value: object, name: str) -> tuple[float, float, float]:
    x, y, z = _numbers(value, 3, name)
    return x, y, z


def _numbers(value: object, count: int, name: str) -> tuple[float, ...]:
    return tuple(_number(part, _FARTHEST, name) for part in _list(value, count, name))


def _list(value: object, count: int, name: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"{name} is {_told(value)}, wanted a list of {count}")
    return value


def _number(value: object, most: float, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > most:
        raise InputError(f"{name} is {_told(value)}, wanted a number up to {most:g}")
    return float(value)


def _whole(value: object, least: int, most: int, name: str) -> int:
    if type(value) is not int or not least <= value <= most:
        raise InputError(f"{name} is {_told(value)}, wanted a whole number from {least} to {most}")
    return value


def _told(value: object) -> str:
    """A value for messages: what there is of it is short, and of printable characters."""
    if value is None:
        return "missing"
    text = ascii(value) if not isinstance(value, list | dict) else f"a {type(value).__name__} of {len(value)}"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
