"""The text of a page: what is shown first, versions, lights and facts around the arrays."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.exporters.packers import Exportable, floats, pack
from diffprt.exporters.web.default_light import default_light
from diffprt.exporters.web.fallback_picture import fallback_picture
from diffprt.exporters.web.page_arrays import ArrayStore, version_entry
from diffprt.exporters.web.page_template import fill_template, joined_scripts, page_source, script_json, shader_elements
from diffprt.exporters.web.versions import collect
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.shading import CURVES
from diffprt.transfer import GlossyTransfer, Transfer


def page_content(
    asset: Exportable,
    *,
    lights: dict[str, Light] | None = None,
    camera: Camera | None = None,
    exposure: float = 1.0,
    curve: str = "aces",
    title: str = "",
    registers: int | None = None,
    versions: Mapping[str, Exportable] | None = None,
    uncompressed: Transfer | GlossyTransfer | None = None,
    before: Exportable | None = None,
) -> tuple[bytes, dict[str, int], tuple[str, ...]]:
    """The page of `export`, the bytes of its parts, and what was left out of it."""
    pack(asset, registers=registers)  # complains first of what is not an asset
    receivers = asset.receivers
    if len(receivers.faces) == 0:
        raise InputError("asset has no faces to draw: bake a mesh, or give its receivers faces")
    lights = {"Sky and sun": default_light(asset.order)} if lights is None else lights
    _check_lights(lights, asset.order)
    if curve not in CURVES:
        raise InputError(f"tone curve '{curve}' is unknown: use one of {', '.join(CURVES)}")
    if not (math.isfinite(exposure) and exposure > 0):
        raise InputError(f"exposure is {exposure}: give a positive factor")
    collected = collect(asset, registers=registers, versions=versions, uncompressed=uncompressed, before=before)
    camera = camera or Camera.framing(receivers.positions)
    title = title or "diffprt"

    store = ArrayStore()
    entries = [version_entry(name, packed, store) for name, packed in collected.packed.items()]
    own = next(iter(collected.packed.values()))
    heat: dict[str, Any] = {}
    if collected.error is not None:
        # One outlier would leave all else in the lowest color.
        heat = {"error": store.add("error", collected.error), "most": float(np.quantile(collected.error, 0.99))}
    manifest = {
        "title": title,
        "path": "single" if registers is None else "passes",
        "facts": {"vertices": len(receivers), "triangles": len(receivers.faces), **own.facts},
        "versions": entries,
        "heat": heat,
        "arrays": store.forms,
        "bounds": _bounds(receivers.positions),
        "camera": {
            "eye": camera.eye,
            "target": camera.target,
            "up": camera.up,
            "fov": camera.fov,
            "aspect": camera.width / camera.height,
        },
        "exposure": exposure,
        "curve": curve,
        "lights": [
            {"name": name, "coefficients": _short_numbers(light.coefficients)} for name, light in lights.items()
        ],
        "certificate": asset.certificate,
    }
    programs = [name for packed in collected.packed.values() for name in packed.programs]
    first_light = next(iter(lights.values()))
    page = fill_template(
        {
            "title": html.escape(title),
            "style": page_source("style.css").rstrip(),
            "manifest": script_json(manifest),
            "shaders": "\n".join(shader_elements(programs, registers)),
            "arrays": "\n".join(store.elements),
            "picture": fallback_picture(asset, first_light, camera, exposure=exposure, curve=curve),
            "script": joined_scripts(),
        }
    )
    content = page.encode()
    parts = dict(store.bytes)
    parts["page"] = len(content) - sum(parts.values())
    return content, parts, collected.left_out


def _check_lights(lights: dict[str, Light], order: int) -> None:
    if not lights:
        raise InputError("lights are empty: give at least one, or None for the built-in one")
    for light in lights.values():
        count = light.coefficients.shape[0]
        if count != order**2:
            raise InputError(
                f"transfer has {order**2} SH coefficients, light has {count}: "
                f"project the light with order={order}, or bake with order={light.order}"
            )
    for name, light in lights.items():
        if not bool(torch.isfinite(light.coefficients).all()):
            raise InputError(f"light '{name}' has coefficients that are not finite: project it again")


def _bounds(positions: torch.Tensor) -> dict[str, Any]:
    points = positions.detach().cpu().double()
    center = (points.amin(0) + points.amax(0)) / 2
    radius = float((points - center).norm(dim=1).max())
    return {"center": center.tolist(), "radius": max(radius, 1e-12)}


def _short_numbers(coefficients: torch.Tensor) -> list[float]:
    """Row-major values, as the shortest decimals that give the same float32 again."""
    return [float(str(value)) for value in floats(coefficients).ravel()]
