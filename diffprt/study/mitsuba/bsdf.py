"""BRDFs as Mitsuba's own BSDFs, described for `mitsuba.load_dict`."""

from __future__ import annotations

from types import ModuleType

import torch

from diffprt.brdf import GGX, Brdf, Conductor, CookTorrance, Lambert, ModifiedPhong, is_own
from diffprt.errors import InputError
from diffprt.study.mitsuba.phong import phong_bsdf


def mitsuba_bsdf(mitsuba: ModuleType, brdf: Brdf) -> dict:
    """One-sided, as ours.

    Raises:
        InputError: Mitsuba has no such BSDF.
    """
    if is_own(brdf):  # a subclass of one that Mitsuba has may reflect otherwise
        raise InputError(f"Mitsuba has no {type(brdf).__name__}: compare lambert, phong, cook-torrance or ggx")
    if isinstance(brdf, Lambert):
        return {"type": "diffuse", "reflectance": _color(brdf.diffuse)}
    if isinstance(brdf, ModifiedPhong):
        return phong_bsdf(mitsuba, brdf)
    assert isinstance(brdf, CookTorrance | GGX)
    return _facets(brdf)


def _facets(brdf: CookTorrance | GGX) -> dict:
    """A rough conductor, blended with a diffuse surface where there is a Lambertian part."""
    if brdf.masking != "smith":
        raise InputError(f"masking is '{brdf.masking}' and Mitsuba has Smith's alone: give masking=smith to compare")
    diffuse, specular = (float(w.detach().max()) for w in (brdf.diffuse, brdf.specular))
    if diffuse + specular > 1 + 1e-6:
        raise InputError(
            f"the largest diffuse and specular weights add up to {diffuse + specular:.4g}, which Mitsuba's blend "
            "cannot hold: lower one to compare"
        )
    share = specular / (diffuse + specular) if diffuse > 0 else 1.0
    described = {
        "type": "roughconductor",
        "distribution": "ggx" if isinstance(brdf, GGX) else "beckmann",
        "alpha": float(brdf.roughness.detach()),
        "specular_reflectance": _color(brdf.specular / share if share > 0 else brdf.specular),
    }
    if isinstance(brdf.fresnel, Conductor):
        described |= {"eta": _color(brdf.fresnel.eta), "k": _color(brdf.fresnel.k)}
    elif bool((brdf.fresnel.f0.detach() == 1).all()):
        described["material"] = "none"
    else:
        raise InputError("f0 is below 1 and Mitsuba has no Schlick term: give eta and k, or f0=1, to compare")
    if diffuse == 0:
        return described
    even = {"type": "diffuse", "reflectance": _color(brdf.diffuse / (1 - share))}
    return {"type": "blendbsdf", "weight": share, "first": even, "second": described}


def _color(value: torch.Tensor) -> dict:
    return {"type": "rgb", "value": value.detach().double().expand(3).tolist()}
