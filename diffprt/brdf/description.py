"""BRDFs by name: as plain values, which assets record, and as text, which the command line takes."""

from __future__ import annotations

from dataclasses import fields

from diffprt.brdf.interface import Brdf, Lambert
from diffprt.brdf.microfacet import GGX, CookTorrance
from diffprt.brdf.parameter import described
from diffprt.brdf.phong import ModifiedPhong, Phong
from diffprt.errors import InputError

BRDFS: dict[str, type[Brdf]] = {
    "lambert": Lambert,
    "phong": Phong,
    "modified-phong": ModifiedPhong,
    "cook-torrance": CookTorrance,
    "ggx": GGX,
}


def describe_brdf(brdf: Brdf) -> dict:
    """The BRDF as plain values: "name", and each parameter as a number, three numbers or a word.

    One that is not in `BRDFS` is named by its class; `brdf_of` does not read it back.

    Raises:
        InputError: a parameter is no plain value.
    """
    kind = type(brdf)
    names = {known: name for name, known in BRDFS.items()}
    return {"name": names.get(kind, f"{kind.__module__}.{kind.__qualname__}"), **described(brdf)}


def brdf_of(description: dict) -> Brdf:
    """The BRDF of plain values as `describe_brdf` makes them; parameters left out have their defaults.

    Raises:
        InputError: an unknown name or parameter, or a value out of range.
    """
    given = dict(description)
    name = given.pop("name", None)
    if name not in BRDFS:
        raise InputError(f"name '{name}' is unknown: use one of {', '.join(BRDFS)}")
    known = BRDFS[name].parameters()
    unknown = next((key for key in given if key not in known), None)
    if unknown is not None:
        raise InputError(f"{name} has no parameter '{unknown}': give {', '.join(known)}")
    return BRDFS[name].of(**{key: tuple(value) if isinstance(value, list) else value for key, value in given.items()})


def parse_brdf(text: str) -> Brdf:
    """The BRDF of "name:key=value,key=value"; a color is three numbers, as in "specular=0.9,0.6,0.3".

    Raises:
        InputError: not of this form, or as `brdf_of`.
    """
    name, _, rest = text.partition(":")
    values: dict[str, list[str]] = {}
    key = None
    for part in rest.split(",") if rest else []:
        before, equals, after = part.partition("=")
        if equals and before.strip() in values:
            raise InputError(f"brdf '{text}' gives {before.strip()} twice: give it once")
        if equals:
            key = before.strip()
        if key is None:
            raise InputError(f"brdf '{text}' has '{part}' without a parameter: write {name}:parameter=value")
        values.setdefault(key, []).append(after if equals else part)
    try:
        name = name.strip().lower()
        words = {f.name for f in fields(BRDFS.get(name, Brdf)) if f.type == "str"}
        return brdf_of({"name": name, **{k: _value(k, v, words) for k, v in values.items()}})
    except InputError as error:
        raise InputError(f"brdf '{text}': {error}") from None


def _value(key: str, parts: list[str], words: set[str]) -> float | list[float] | str:
    """A word where the parameter is one, else one number or three."""
    if key in words:
        return ",".join(parts).strip()
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3):
        raise InputError(f"{key} is '{','.join(parts)}': give one number, or three for a color")
    return numbers[0] if len(numbers) == 1 else numbers
