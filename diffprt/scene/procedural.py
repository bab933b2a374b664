"""Environments that need no file: a clear sky, a studio, a constant."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene.environment import Environment
from diffprt.scene.sky import sky_luminance, sun_direction, sun_illuminance, sun_image

_BUILTIN = "builtin:"
BUILTIN_ENVIRONMENTS = ("sky", "studio", "constant")

# The grid that fixes a sky's exposure, whatever its resolution.
_EXPOSURE_ROWS = 256
# Softboxes: direction of the centre, half width and half height (tangents of angles), softness, RGB.
_SOFTBOXES = (
    ((-0.75, 0.65, -0.45), 0.55, 0.40, 0.06, (9.0, 8.6, 8.0)),
    ((0.85, 0.25, -0.40), 0.50, 0.70, 0.12, (1.6, 1.8, 2.2)),
    ((0.30, 0.55, 0.90), 0.75, 0.16, 0.04, (7.0, 7.4, 8.0)),
)


def builtin_environment(name: str, *, height: int = 256) -> Environment:
    """The built-in environment `name`, one of `BUILTIN_ENVIRONMENTS`, `height` rows.

    Raises:
        InputError: an unknown name.
    """
    if name == "sky":
        return sky_environment(height)
    if name == "studio":
        return studio_environment(height)
    if name == "constant":
        return Environment(torch.ones(_rows(height), 2 * height, 3), "constant")
    raise InputError(f"built-in environment '{name}' is unknown: known are {', '.join(BUILTIN_ENVIRONMENTS)}")


def load_environment(spec: str | Path | Environment, **options: str) -> Environment:
    """An environment from what a user typed: a path, "builtin:NAME", or an environment as it is.

    `options` are those of `Environment.load`.
    """
    if isinstance(spec, Environment):
        return spec
    if str(spec).startswith(_BUILTIN):
        return builtin_environment(str(spec)[len(_BUILTIN) :])
    return Environment.load(spec, **options)


def sky_environment(
    height: int = 256,
    *,
    sun_elevation: float = math.radians(45),
    sun_azimuth: float = math.radians(35),
    turbidity: float = 2.5,
    ground_albedo: float | tuple[float, float, float] = (0.2, 0.19, 0.17),
    sun: bool = True,
) -> Environment:
    """A clear sky with its sun over a diffuse ground (Preetham, Shirley and Smits 1999).

    Exposed so that the irradiance on the ground, averaged over RGB, is π; the ground reflects its own
    colour's share of it. The sun is a disc of radius 0.2665 degree whose energy does not depend on `height`.

    Args:
        height: rows; the map is twice as wide.
        sun_elevation: above the horizon [rad], in (0, π/2].
        sun_azimuth: from -z, the map's centre, towards +x [rad].
        turbidity: haze, 2 (clear) to 10; below 2 the model does not hold.
        ground_albedo: a number or RGB in [0, 1].
        sun: False leaves the disc out; the exposure stays that of the sky with it.

    Raises:
        InputError: an argument out of range.
    """
    _rows(height)
    if not 0 < sun_elevation <= math.pi / 2 + 1e-9:
        raise InputError(f"sky has sun_elevation={sun_elevation:g} rad: give more than 0, up to {math.pi / 2:.4f}")
    if not 2 <= turbidity <= 10:
        raise InputError(f"sky has turbidity={turbidity:g}: give 2 (clear) to 10 (haze)")
    if not math.isfinite(sun_azimuth):
        raise InputError(f"sky has sun_azimuth={sun_azimuth}: give a finite angle in radians")
    albedo = torch.as_tensor(ground_albedo, dtype=torch.float64).expand(3)
    if not bool(((albedo >= 0) & (albedo <= 1)).all()):
        raise InputError(f"sky has ground_albedo={albedo.tolist()}: reflectance lies in [0, 1]")

    toward = sun_direction(min(sun_elevation, math.pi / 2), sun_azimuth)
    direct = sun_illuminance(sun_elevation, turbidity)
    irradiance = _sky_irradiance(toward, turbidity) + direct * toward[1]
    exposure = math.pi / float(irradiance.mean())

    directions = sh.map_directions(height, 2 * height, torch.float64)
    ground = albedo * irradiance / math.pi
    image = torch.where(directions[..., 1:2] > 0, sky_luminance(directions, toward, turbidity), ground)
    if sun:
        image = image + sun_image(height, toward, direct)
    return Environment((image * exposure).float(), "sky")


def studio_environment(height: int = 256) -> Environment:
    """Three softboxes (key, fill, rim) with soft edges over a dim grey room; mean radiance 1."""
    directions = sh.map_directions(_rows(height), 2 * height, torch.float64)
    up = directions[..., 1:2]
    image = (0.16 + 0.10 * up.clamp(-1, 1)) * torch.tensor([1.0, 1.0, 1.02], dtype=torch.float64)
    for center, half_width, half_height, softness, color in _SOFTBOXES:
        forward = torch.nn.functional.normalize(torch.tensor(center, dtype=torch.float64), dim=0)
        right = torch.nn.functional.normalize(
            torch.linalg.cross(forward, torch.tensor([0.0, 1, 0], dtype=torch.float64)), dim=0
        )
        above = torch.linalg.cross(right, forward)
        depth = directions @ forward
        x, y = (directions @ axis / depth.clamp_min(1e-6) for axis in (right, above))
        inside = _soft(half_width - x.abs(), softness) * _soft(half_height - y.abs(), softness) * (depth > 0)
        image = image + inside[..., None] * torch.tensor(color, dtype=torch.float64)
    rows = sh.row_weights(height, 2 * height)
    mean = torch.einsum("hwc,h->", image, rows) / (12 * math.pi)
    return Environment((image / mean).float(), "studio")


def _rows(height: int) -> int:
    if not 2 <= height <= 8192:
        raise InputError(f"environment has height {height}: give 2 to 8192 rows")
    return height


def _sky_irradiance(sun: torch.Tensor, turbidity: float) -> torch.Tensor:
    """Irradiance [3] of the sky without its sun on level ground."""
    directions = sh.map_directions(_EXPOSURE_ROWS, 2 * _EXPOSURE_ROWS, torch.float64)[: _EXPOSURE_ROWS // 2]
    rows = sh.row_weights(_EXPOSURE_ROWS)[: _EXPOSURE_ROWS // 2]
    weighted = sky_luminance(directions, sun, turbidity) * directions[..., 1:2]
    return torch.einsum("hwc,h->c", weighted, rows)


def _soft(distance: torch.Tensor, softness: float) -> torch.Tensor:
    """Smooth step from 0 outside to 1 inside, over twice the softness."""
    t = (distance / (2 * softness) + 0.5).clamp(0, 1)
    return t * t * (3 - 2 * t)
