"""Arguments that several commands share: scenes, lights, colors, cameras."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.options.bake import CONVERGED
from diffprt.scene import BUILTIN_ENVIRONMENTS, Environment, Light, Scene, builtin_environment


def parse_color(text: str, name: str) -> tuple[float, float, float]:
    """A number or three, separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(math.isfinite(v) for v in values):
        raise InputError(f"{name} is '{text}': give one number or three, such as 0.8 or 0.8,0.7,0.6")
    return tuple(values * (3 // len(values)))


def parse_number(text: str, name: str) -> float:
    """One positive number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"{name} is '{text}': give a positive number")
    return value


def parse_size(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT or one side."""
    try:
        sides = [int(part) for part in text.lower().split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise InputError(f"size is '{text}': give pixels such as 512 or 640x480")
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
    return clusters, components


def load_scene(
    source: str, *, albedo: str | None, ground: bool, occluders: list[str], **loading: str | bool | None
) -> Scene:
    """The scene of a file or "builtin:NAME", with what options add to it.

    Args:
        albedo: replaces every albedo of `source`, one number or three; None keeps them.
        ground: adds a ground that catches shadows.
        occluders: files or "builtin:NAME" that only block light.
        loading: `up`, `non_finite`, `winding` and `recenter` of `Scene.load`, for `source` and occluders.
    """
    if loading.get("recenter") and occluders:
        raise InputError("--recenter moves every file on its own: leave out --occluder, or join the files before")
    scene = Scene.load(source, **loading)
    if albedo is not None:
        scene = scene.with_albedo(torch.tensor(parse_color(albedo, "albedo")))
    for path in occluders:
        scene = scene.with_occluder(Scene.load(path, **loading))
    return scene.with_ground() if ground else scene


def load_light(source: str, order: int, *, window: str = "none", azimuth: float = 0.0) -> Light:
    """The light of a built-in environment or of a map, projected at `order` and turned about +y.

    Args:
        source: "sky", "studio", ..., or the path of an equirectangular .hdr or .exr map.
        azimuth: degrees.
    """
    source = source.removeprefix("builtin:")
    environment = builtin_environment(source) if source in BUILTIN_ENVIRONMENTS else Environment.load(Path(source))
    light = environment.project(order, window=window)
    return light.rotate(turn_about_y(azimuth)) if azimuth else light


def turn_about_y(degrees: float) -> torch.Tensor:
    """Rotation matrix about +y, counter-clockwise seen from above."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
