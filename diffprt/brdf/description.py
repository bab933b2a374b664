"""BRDFs by name: as plain values, which assets record, and as text, which the command line takes."""

from __future__ import annotations

from diffprt.brdf.cook_torrance import CookTorrance
from diffprt.brdf.fresnel import Conductor, Schlick
from diffprt.brdf.ggx import GGX
from diffprt.brdf.interface import Brdf
from diffprt.brdf.lambert import Lambert
from diffprt.brdf.phong import ModifiedPhong, Phong
from diffprt.errors import InputError

BRDFS: dict[str, type[Brdf]] = {
    "lambert": Lambert,
    "phong": Phong,
    "modified-phong": ModifiedPhong,
    "cook-torrance": CookTorrance,
    "ggx": GGX,
}
_FACETS = ("diffuse", "specular", "roughness", "masking", "f0", "eta", "k")
_PARAMETERS = {
    "lambert": ("diffuse",),
    "phong": ("diffuse", "specular", "exponent"),
    "modified-phong": ("diffuse", "specular", "exponent"),
    "cook-torrance": _FACETS,
    "ggx": _FACETS,
}


def describe_brdf(brdf: Brdf) -> dict:
    """The BRDF as plain values: "name", and each parameter as a number, three numbers or a word."""
    name = next(name for name, kind in BRDFS.items() if type(brdf) is kind)
    fresnel = getattr(brdf, "fresnel", None)
    values = {key: getattr(brdf, key, getattr(fresnel, key, None)) for key in _PARAMETERS[name]}
    plain = {
        key: value if isinstance(value, str) else value.detach().tolist()
        for key, value in values.items()
        if value is not None
    }
    return {"name": name, **plain}


def brdf_of(description: dict) -> Brdf:
    """The BRDF of plain values as `describe_brdf` makes them; parameters left out have their defaults.

    Raises:
        InputError: an unknown name or parameter, or a value out of range.
    """
    given = dict(description)
    name = given.pop("name", None)
    if name not in BRDFS:
        raise InputError(f"name '{name}' is unknown: use one of {', '.join(BRDFS)}")
    unknown = next((key for key in given if key not in _PARAMETERS[name]), None)
    if unknown is not None:
        raise InputError(f"{name} has no parameter '{unknown}': give {', '.join(_PARAMETERS[name])}")
    given = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
    fresnel = {key: given.pop(key) for key in ("f0", "eta", "k") if key in given}
    if "f0" in fresnel and len(fresnel) > 1:
        raise InputError("f0 stands beside eta or k: give f0 (Schlick), or eta and k (a metal)")
    if len(fresnel) == 1 and "f0" not in fresnel:
        raise InputError(f"{next(iter(fresnel))} stands alone: a metal has both eta and k")
    if fresnel:
        given["fresnel"] = Schlick(**fresnel) if "f0" in fresnel else Conductor(**fresnel)
    return BRDFS[name](**given)


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
        return brdf_of({"name": name.strip().lower(), **{k: _value(k, v) for k, v in values.items()}})
    except InputError as error:
        raise InputError(f"brdf '{text}': {error}") from None


def _value(key: str, parts: list[str]) -> float | list[float] | str:
    """A word for masking, else one number or three."""
    if key == "masking":
        return ",".join(parts).strip()
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3):
        raise InputError(f"{key} is '{','.join(parts)}': give one number, or three for a color")
    return numbers[0] if len(numbers) == 1 else numbers
