"""One HTML file that holds an asset, its shaders and a viewer, and needs nothing else."""

from __future__ import annotations

import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.exporters.packers.packed import floats
from diffprt.exporters.packers.registry import pack
from diffprt.exporters.web.arrays import ArrayStore, version_entry
from diffprt.exporters.web.fallback_picture import fallback_picture
from diffprt.exporters.web.lights import default_light
from diffprt.exporters.web.page_content import Page
from diffprt.exporters.web.template import fill_template, joined_scripts, page_source, script_json, shader_elements
from diffprt.exporters.web.versions import collect
from diffprt.exporters.web.within_bytes import shrunk
from diffprt.options import CURVES, ExportOptions, takes
from diffprt.rendering import PictureWindow
from diffprt.rendering.exposure import white
from diffprt.representation import Representation
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.whole_file import make_folder, write_whole

# Bytes of a signal beside those that it has deflated, at most.
_MOST_DEFLATED = 8


@takes(ExportOptions)
def export(asset: Representation, directory: str | Path, options: ExportOptions) -> dict:
    """Writes `directory/index.html`, a page that relights the asset in any browser with WebGL 2.

    The page opens from disk, asks the network for nothing, and computes what `shade` and `tone_map` compute:
    the same sums in 32-bit floats, interpolated as `render` does it and tone-mapped per pixel. Its shaders are printed
    from `diffprt.exporters.shaders`, its arrays are stored in 16 bits and deflated (`web/compact.py`).
    `window.diffprt` in the page takes other lights, cameras and settings from a script (`page/scripting.js`).

    The page shows the asset and other versions of it, one alone or two side by side with a slider between them.
    Diffuse assets come with an unshadowed version, which needs normals alone.

    Args:
        asset: diffuse or glossy transfer, plain or clustered, on receivers with faces.
        directory: made if missing; an index.html in it is replaced whole or not at all.
        options: each a keyword; `diffprt.options.ExportOptions` describes them.

    Returns:
        {"path": str, "bytes": int, "parts": {"geometry", "signal", "page"}, "counts": {"vertices", "triangles"},
        "programs": [str], "left_out": [str]}; the parts are bytes in the file (deflated and in base64 where binary)
        and sum to its size; the shaders that draw the asset; what was left out of the page, in words.

    Raises:
        InputError: the asset has no faces or no shader, a light or version has another order than the asset or a
            version another mesh, an option is out of range, or the directory cannot be made or written.
    """
    path = Path(directory) / "index.html"
    page = page_of(asset, options)
    make_folder(path.parent)
    write_whole(path, page.content, "page")
    return {
        "path": str(path),
        "bytes": len(page.content),
        "parts": page.parts,
        "counts": page.counts,
        "programs": list(page.programs),
        "left_out": list(page.left_out),
    }


def page_of(asset: Representation, options: ExportOptions) -> Page:
    """The page of `export`, of at most `options.bytes`, where that is given."""
    size = options.bytes
    if size is None:
        return _page(asset, options)
    # So much does not fit, and may be more than can be packed at all.
    if asset.compressed or asset.nbytes <= _MOST_DEFLATED * size:
        page = _page(asset, options)
        if len(page.content) > size and options.uncompressed is not None:
            page = _page(asset, options, compared=False)
        if len(page.content) <= size:
            return page
    return shrunk(asset, size, lambda smaller, left: _page(smaller, options, compared=False, left_out=left))


def _page(
    asset: Representation, options: ExportOptions, *, compared: bool = True, left_out: tuple[str, ...] = ()
) -> Page:
    """What is shown first, versions, lights and facts around the arrays.

    Args:
        asset: shown first.
        options: of the page.
        compared: whether it may hold the uncompressed transfer as a version.
        left_out: in words, of the asset.
    """
    packed = pack(asset)
    positions = asset.elements.positions
    counts = {"vertices": len(positions), "triangles": len(packed.geometry["indices"])}
    if counts["triangles"] == 0:
        raise InputError("asset has no faces to draw: bake a mesh, or give its receivers faces")
    if asset.order is None:
        raise InputError(f"a {asset.name} answers to no distant light, which the page turns: render it instead")
    lights = {"Sky and sun": default_light(asset.order)} if options.lights is None else options.lights
    _check_lights(lights, asset.order)
    collected = collect(asset, packed, options, compared=compared)
    own = next(iter(collected.packed.values()))
    camera = options.camera or Camera.framing(asset.elements.subject)
    title = options.title or "diffprt"

    store = ArrayStore()
    entries = [version_entry(name, version, store) for name, version in collected.packed.items()]
    # Not of the asset: its bytes are the page's own.
    aside, window = ArrayStore(), {"name": options.window}
    if options.window in ("picture", "auto"):
        rows = PictureWindow.of(asset, camera).rows
        window = {"name": "picture", "rows": aside.add("picture rows", floats(rows))} if len(rows) else {"name": "none"}
    heat: dict[str, Any] = {}
    if collected.error is not None:
        # One outlier would leave all else in the lowest color.
        heat = {"error": store.add("error", collected.error), "most": float(np.quantile(collected.error, 0.99))}
    manifest = {
        "title": title,
        "path": "single" if options.registers is None else "passes",
        "facts": {**counts, **own.facts},
        "versions": entries,
        "heat": heat,
        "arrays": store.forms | aside.forms,
        "bounds": _bounds(positions),
        "camera": {
            "eye": camera.eye,
            "target": camera.target,
            "up": camera.up,
            "fov": camera.fov,
            "aspect": camera.width / camera.height,
        },
        "exposure": options.exposure,
        "curve": options.curve,
        "window": window,
        "white": {curve: white(curve) for curve in CURVES},
        "lights": [
            {
                "name": name,
                "coefficients": _short_numbers(light.coefficients),
                "rings": light.seen() is not light,
            }
            for name, light in lights.items()
        ],
        "certificate": asset.certificate,
    }
    programs = [name for version in collected.packed.values() for name in version.programs]
    page = fill_template(
        {
            "title": html.escape(title),
            "style": page_source("style.css").rstrip(),
            "manifest": script_json(manifest),
            "shaders": "\n".join(shader_elements(programs, options.registers)),
            "arrays": "\n".join([*store.elements, *aside.elements]),
            "picture": fallback_picture(
                asset, next(iter(lights.values())), camera, exposure=options.exposure, curve=options.curve
            ),
            "script": joined_scripts(),
        }
    )
    # A title may hold bytes that are no text, from a file name.
    content = page.encode("utf-8", "replace")
    parts = {**store.bytes, "page": len(content) - sum(store.bytes.values())}
    return Page(content, camera, parts, counts, own.programs, (*left_out, *collected.left_out))


def _check_lights(lights: Mapping[str, Light], order: int) -> None:
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
