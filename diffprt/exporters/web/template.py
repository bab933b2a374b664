"""The page's own files, joined into one: template, style, scripts and shaders."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator
from importlib.resources import files
from typing import Any

import numpy as np
import torch

from diffprt.exporters.shaders import STAGES, shader_source

# In the order of their imports: the page runs them as one module.
_SCRIPTS = (
    "sh.js",
    "matrix.js",
    "tonemap.js",
    "message.js",
    "radiance_hdr.js",
    "project_map.js",
    "payload.js",
    "light_window.js",
    "program.js",
    "table.js",
    "mesh.js",
    "sum_target.js",
    "cluster_light.js",
    "cluster_passes.js",
    "diffuse.js",
    "glossy.js",
    "representations.js",
    "heat_colors.js",
    "heat_map.js",
    "light_ball.js",
    "renderer.js",
    "orbit.js",
    "pointer.js",
    "frame_clock.js",
    "legend.js",
    "panel.js",
    "wipe.js",
    "drop.js",
    "viewer.js",
    "scripting.js",
    "host.js",
    "main.js",
)


def page_source(name: str) -> str:
    """A file of `page/`."""
    return (files("diffprt.exporters.web") / "page" / name).read_text(encoding="utf-8")


def page_classes() -> list[str]:
    """The classes that draw, by the names under which `page/representations.js` lists them."""
    return re.findall(r"^  (\w+): \w+,$", page_source("representations.js"), flags=re.MULTILINE)


def shader_elements(programs: Iterable[str], registers: int | None) -> Iterator[str]:
    """Every stage of the programs, and of those that any asset needs."""
    sizes = {} if registers is None else {"REGISTERS": registers}
    for name in dict.fromkeys((*programs, "sky", "heat_map")):
        for stage in STAGES:
            text = shader_source(name, stage, "glsl-es", sizes=sizes)
            yield f'<script type="text/x-glsl" id="shader:{name}.{stage[:4]}">\n{text}</script>'


def joined_scripts() -> str:
    """The modules one after the other, without the imports that then need no resolving."""
    pieces = []
    for name in _SCRIPTS:
        text = re.sub(r"^import [^;]*;\n", "", page_source(name), flags=re.MULTILINE)
        pieces.append(f"// {name}\n" + re.sub(r"^export ", "", text, flags=re.MULTILINE))
    return "\n".join(pieces).rstrip()


def script_json(value: Any) -> str:
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


def fill_template(entries: dict[str, str]) -> str:
    """Fills the places in one pass, so that nothing filled in is itself searched for places."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: entries[place[1]], page_source("index.html"))
