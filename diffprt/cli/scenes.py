"""Scenes and lights that commands are given."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from diffprt.cli.parsing import parse_color
from diffprt.errors import InputError
from diffprt.options.view import PICTURE_WINDOW
from diffprt.scene import BUILTIN_ENVIRONMENTS, Environment, Light, Scene, builtin_environment

if TYPE_CHECKING:
    from diffprt.rendering import PictureWindow


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


def load_light(
    source: str,
    order: int | None,
    *,
    window: str = "none",
    azimuth: float = 0.0,
    picture: PictureWindow | None = None,
) -> Light:
    """The light of a built-in environment or of a map, projected at `order` and turned about +y.

    Args:
        source: "sky", "studio", ..., or the path of an equirectangular .hdr or .exr map.
        order: of the asset that it is for; None where that answers to no distant light.
        azimuth: degrees.
        picture: what decides on the window where `window` is "picture"; without it, there is none.

    Raises:
        InputError: there is no such light, or the asset answers to none.
    """
    if order is None:
        raise InputError("the asset answers to no distant light: light it in Python, with the lights that it names")
    source = source.removeprefix("builtin:")
    environment = builtin_environment(source) if source in BUILTIN_ENVIRONMENTS else Environment.load(Path(source))
    if not math.isfinite(azimuth):
        raise InputError(f"light has azimuth {azimuth}: give a finite number of degrees")
    turn = turn_about_y(azimuth) if azimuth else None
    if window == PICTURE_WINDOW and picture is not None:
        return picture.project(environment, turn)
    light = environment.project(order, window="none" if window == PICTURE_WINDOW else window)
    return light if turn is None else light.rotate(turn)


def turn_about_y(degrees: float) -> torch.Tensor:
    """Rotation matrix about +y, counter-clockwise seen from above."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
