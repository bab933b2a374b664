"""Lights of simple shape, projected in closed form (SH conventions: `diffprt.sh`; lengths in metres).

Every function takes numbers, sequences or tensors, computes in float64, and returns a `Light` in `dtype`.
Gradients reach every argument that is given as a tensor. Colours are RGB triples; one number means grey. An
order outside 1..10 raises InputError.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene.light import Light

Vector = Sequence[float] | torch.Tensor
Color = float | Sequence[float] | torch.Tensor

# Relative to the polygon's size: how far corners may leave their plane, how near to it a viewpoint may lie.
PLANE_TOLERANCE = 1e-3
VIEW_TOLERANCE = 1e-9


def directional_light(
    direction: Vector, irradiance_rgb: Color, order: int, *, dtype: torch.dtype = torch.float32
) -> Light:
    """A light infinitely far away and infinitely small, such as an idealised sun.

    Args:
        direction: [3], from the scene towards the light; any length but zero.
        irradiance_rgb: irradiance on a surface that faces the light [W/m²], >= 0.
        order: 1..10. Projected radiance rings; see `diffprt.sh.apply_window`.
    Raises:
        InputError: zero or non-finite direction; negative or non-finite irradiance.
    """
    values = sh.basis(_direction(direction), sh.check_order(order))
    return _light(values, _color(irradiance_rgb, "irradiance"), dtype)


def disc_light(
    direction: Vector,
    half_angle_radians: float | torch.Tensor,
    radiance_rgb: Color,
    order: int,
    *,
    dtype: torch.dtype = torch.float32,
) -> Light:
    """A distant round light of constant radiance: all directions within a half angle (the sun's is 0.00465).

    Args:
        direction: [3], from the scene towards the centre of the disc; any length but zero.
        half_angle_radians: in (0, π].
        radiance_rgb: [W/m²/sr], >= 0.
        order: 1..10.
    Raises:
        InputError: zero direction, half angle outside (0, π], negative radiance.
    """
    zonal = sh.cap(torch.as_tensor(half_angle_radians, dtype=torch.float64), order)
    return _light(sh.rotate_zonal(zonal, _direction(direction)), _color(radiance_rgb, "radiance"), dtype)


def sphere_light(
    center: Vector,
    radius: float | torch.Tensor,
    radiance_rgb: Color,
    order: int,
    *,
    at: Vector = (0.0, 0.0, 0.0),
    dtype: torch.dtype = torch.float32,
) -> Light:
    """A glowing ball as seen from the point `at`: a disc of half angle asin(radius / distance).

    The result is a distant light: right at `at`, and elsewhere the less so the nearer the ball.

    Args:
        center: [3].
        radius: > 0.
        radiance_rgb: [W/m²/sr], >= 0.
        order: 1..10.
        at: [3], the viewpoint, outside the ball.
    Raises:
        InputError: radius not above 0, `at` inside the ball or on it, negative radiance.
    """
    offset = _vector(center, "center") - _vector(at, "at")
    radius = torch.as_tensor(radius, dtype=torch.float64)
    distance = torch.linalg.vector_norm(offset)
    found, away = float(radius.detach()), float(distance.detach())
    if not 0 < found < torch.inf:
        raise InputError(f"sphere light has radius {found:g}: give a radius above 0")
    if away <= found:
        raise InputError(
            f"viewpoint is {away:g} from the centre of a sphere light of radius {found:g}: "
            "move `at` outside, or use constant_light for the inside"
        )
    half_angle = torch.asin(radius / distance)
    return disc_light(offset, half_angle, radiance_rgb, order, dtype=dtype)


def area_light(
    corners: Sequence[Sequence[float]] | torch.Tensor,
    radiance_rgb: Color,
    order: int,
    *,
    at: Vector = (0.0, 0.0, 0.0),
    two_sided: bool = False,
    dtype: torch.dtype = torch.float32,
) -> Light:
    """A flat polygon of constant radiance as seen from the point `at`, projected exactly
    (`sh.project_polygon`).

    Args:
        corners: [N, 3], N >= 3, in one plane; a simple polygon, convex or not. It shines to the side from
            which the corners run counterclockwise.
        radiance_rgb: [W/m²/sr], >= 0.
        order: 1..10.
        at: [3], the viewpoint.
        two_sided: shine to both sides. Otherwise the light is zero seen from behind.
    Raises:
        InputError: corners not [N >= 3, 3], not finite, without area or not flat; `at` in the plane of the
            polygon; negative radiance.
    """
    corners = torch.as_tensor(corners, dtype=torch.float64)
    if corners.dim() != 2 or corners.shape[0] < 3 or corners.shape[1] != 3 or not torch.isfinite(corners).all():
        raise InputError(f"area light has corners {list(corners.shape)}: give at least 3 finite corners, [N, 3]")
    seen = corners - _vector(at, "at")
    color = _color(radiance_rgb, "radiance")
    # Newell's area vector: twice the area along the normal, for any simple polygon.
    local = (corners - corners[0]).detach()
    area_vector = torch.linalg.cross(local, local.roll(-1, 0)).sum(0)
    size = float(torch.linalg.vector_norm(local, dim=-1).max())
    double_area = float(torch.linalg.vector_norm(area_vector))
    if double_area <= 1e-12 * size**2:
        raise InputError("area light has no area: give corners that are not all on one line")
    normal = area_vector / double_area
    bend = float((local @ normal).abs().max())
    if bend > PLANE_TOLERANCE * size:
        raise InputError(
            f"area light is not flat: a corner is {bend:g} off the plane, want at most "
            f"{PLANE_TOLERANCE * size:g}; split it into triangles"
        )
    height = -float(seen[0].detach() @ normal)
    if abs(height) <= VIEW_TOLERANCE * size:
        raise InputError("viewpoint lies in the plane of the area light: move `at` off that plane")
    values = sh.project_polygon(seen, order)
    return _light(values if two_sided or height > 0 else values * 0, color, dtype)


def constant_light(radiance_rgb: Color, order: int, *, dtype: torch.dtype = torch.float32) -> Light:
    """The same radiance [W/m²/sr] from everywhere (a white furnace).

    Args:
        radiance_rgb: [W/m²/sr], >= 0.
        order: 1..10.
    Raises:
        InputError: negative or non-finite radiance.
    """
    values = torch.zeros(sh.coefficient_count(order), dtype=torch.float64)
    values[0] = (4 * torch.pi) ** 0.5
    return _light(values, _color(radiance_rgb, "radiance"), dtype)


def _light(values: torch.Tensor, color: torch.Tensor, dtype: torch.dtype) -> Light:
    return Light((values[:, None] * color).to(dtype))


def _vector(value: Vector, name: str) -> torch.Tensor:
    vector = torch.as_tensor(value, dtype=torch.float64)
    if tuple(vector.shape) != (3,) or not torch.isfinite(vector).all():
        raise InputError(f"{name} is {vector.tolist()}: give three finite numbers")
    return vector


def _direction(value: Vector) -> torch.Tensor:
    vector = _vector(value, "direction")
    length = torch.linalg.vector_norm(vector)
    if not float(length.detach()) > 0:
        raise InputError("direction of the light is zero: give a vector that points towards the light")
    return vector / length


def _color(value: Color, name: str) -> torch.Tensor:
    color = torch.as_tensor(value, dtype=torch.float64)
    if color.dim() == 0:
        color = color.expand(3)
    if tuple(color.shape) != (3,) or not torch.isfinite(color).all() or bool((color < 0).any()):
        raise InputError(f"{name} is {color.tolist()}: give one number or three (RGB), finite and not negative")
    return color
