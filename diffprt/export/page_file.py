"""One HTML file that holds an asset, its shaders and a viewer, and needs nothing else."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.export.default_light import default_light
from diffprt.export.representations import Exportable, Packed, floats, pack
from diffprt.export.shading import STAGES, shader_source
from diffprt.export.whole_file import write_whole
from diffprt.render.camera import Camera
from diffprt.scene import Light
from diffprt.shade import CURVES

# In the order of their imports: the page runs them as one module.
_SCRIPTS = (
    "sh.js",
    "matrix.js",
    "tonemap.js",
    "payload.js",
    "program.js",
    "table.js",
    "mesh.js",
    "sum_target.js",
    "cluster_light.js",
    "cluster_passes.js",
    "diffuse.js",
    "glossy.js",
    "representations.js",
    "light_ball.js",
    "renderer.js",
    "orbit.js",
    "pointer.js",
    "frame_clock.js",
    "panel.js",
    "main.js",
)


def export(
    asset: Exportable,
    directory: str | Path,
    *,
    lights: dict[str, Light] | None = None,
    camera: Camera | None = None,
    exposure: float = 1.0,
    curve: str = "aces",
    title: str = "",
    registers: int | None = None,
) -> dict:
    """Writes `directory/index.html`, a page that relights the asset in any browser with WebGL 2.

    The page opens from disk, asks the network for nothing, and computes what `shade` and `tone_map` compute:
    the same sums in 32-bit floats, interpolated as `render` does it and tone-mapped per pixel. Its shaders are printed
    from `diffprt.export.shading`.
    `window.diffprt` in the page takes other lights, cameras and settings from a script (`page/main.js`).

    Args:
        asset: diffuse or glossy transfer, plain or clustered, on receivers with faces.
        directory: made if missing; an index.html in it is replaced whole or not at all.
        lights: lights to choose from, by the name shown, of the asset's order; the first one is shown first.
            Without them, a plain sky with a sun.
        camera: the first view; without it, one that frames the asset.
        exposure: factor on radiance, positive.
        curve: tone curve that is on first, one of `CURVES`.
        title: shown as the page's heading.
        registers: draws clustered diffuse transfer super-cluster by super-cluster, with that many float4 uniforms a
            pass (256 in the thesis of 2005), and adds the passes up; without it, in one pass from textures.

    Returns:
        {"path": str, "bytes": int, "parts": {"geometry", "signal", "page"}}; the parts are bytes in the file
        (base64 where binary) and sum to its size.

    Raises:
        InputError: the asset has no faces or no shader, a light has another order than the asset, an option
            is out of range, or the directory cannot be made or written.
    """
    packed = pack(asset, registers=registers)
    receivers = asset.receivers
    if len(receivers.faces) == 0:
        raise InputError("asset has no faces to draw: bake a mesh, or give its receivers faces")
    lights = {"Sky and sun": default_light(asset.order)} if lights is None else lights
    _check_lights(lights, asset.order)
    if curve not in CURVES:
        raise InputError(f"tone curve '{curve}' is unknown: use one of {', '.join(CURVES)}")
    if not (math.isfinite(exposure) and exposure > 0):
        raise InputError(f"exposure is {exposure}: give a positive factor")
    camera = camera or Camera.framing(receivers.positions)

    title = title or "diffprt"
    manifest = {
        "title": title,
        "kind": packed.kind,
        "path": "single" if registers is None else "passes",
        "numbers": packed.numbers,
        "facts": {
            "vertices": len(receivers),
            "triangles": len(receivers.faces),
            **packed.facts,
            "geometry_bytes": sum(array.nbytes for array in packed.geometry.values()),
            "signal_bytes": sum(array.nbytes for array in packed.signal.values()),
        },
        "arrays": {
            name: {"dtype": array.dtype.name, "length": array.size}
            for name, array in {**packed.geometry, **packed.signal}.items()
        },
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

    signal_text = "\n".join(_array_element(name, array) for name, array in packed.signal.items())
    geometry_text = "\n".join(_array_element(name, array) for name, array in packed.geometry.items())
    page = _fill_template(
        {
            "title": html.escape(title),
            "style": _source("style.css").rstrip(),
            "manifest": _script_json(manifest),
            "shaders": "\n".join(_shader_elements(packed, registers)),
            "arrays": f"{geometry_text}\n{signal_text}",
            "script": _joined_scripts(),
        }
    )
    content = page.encode()
    path = write_whole(Path(directory) / "index.html", content, "page")
    parts = {"geometry": len(geometry_text), "signal": len(signal_text)}
    parts["page"] = len(content) - sum(parts.values())
    return {"path": str(path), "bytes": len(content), "parts": parts}


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


def _source(name: str) -> str:
    return (files("diffprt.export") / "page" / name).read_text(encoding="utf-8")


def _array_element(name: str, array: np.ndarray) -> str:
    little_endian = array.astype(array.dtype.newbyteorder("<"), copy=False)
    text = base64.b64encode(little_endian.tobytes()).decode("ascii")
    return f'<script type="application/octet-stream;base64" id="array:{name}">{text}</script>'


def _shader_elements(packed: Packed, registers: int | None) -> Iterator[str]:
    sizes = {} if registers is None else {"REGISTERS": registers}
    for name in (*packed.programs, "sky"):
        for stage in STAGES:
            text = shader_source(name, stage, "glsl-es", sizes=sizes)
            yield f'<script type="text/x-glsl" id="shader:{name}.{stage[:4]}">\n{text}</script>'


def _joined_scripts() -> str:
    """The modules one after the other, without the imports that then need no resolving."""
    pieces = []
    for name in _SCRIPTS:
        text = re.sub(r"^import [^;]*;\n", "", _source(name), flags=re.MULTILINE)
        pieces.append(f"// {name}\n" + re.sub(r"^export ", "", text, flags=re.MULTILINE))
    return "\n".join(pieces).rstrip()


def _script_json(value: Any) -> str:
    """JSON that may stand inside a script element: no '<', and no NaN, which JSON lacks."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, (bool, int, str)) or value is None:
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, (np.generic, np.ndarray, torch.Tensor)):
        return _plain(value.tolist())
    return str(value)


def _fill_template(entries: dict[str, str]) -> str:
    """Fills the places in one pass, so that nothing filled in is itself searched for places."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: entries[place[1]], _source("index.html"))
