"""A clear sky with a sun: the analytic model of Preetham, Shirley and Smits (SIGGRAPH 1999)."""

from __future__ import annotations

import math

import torch

from diffprt import sh

SUN_RADIUS = math.radians(0.2665)
# Perez coefficients A..E over turbidity, (slope, offset), for Y, x and y: appendix A.2 of the paper.
_PEREZ = (
    ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)),
    ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)),
    ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)),
)
# Zenith chromaticity: rows for T², T, 1; columns for the cubes, squares, first and zeroth powers of the
# sun's zenith angle.
_ZENITH_X = (
    (0.00166, -0.00375, 0.00209, 0.0),
    (-0.02903, 0.06377, -0.03202, 0.00394),
    (0.11693, -0.21196, 0.06052, 0.25886),
)
_ZENITH_Y = (
    (0.00275, -0.00610, 0.00317, 0.0),
    (-0.04214, 0.08970, -0.04153, 0.00516),
    (0.15346, -0.26756, 0.06670, 0.26688),
)
_RGB_FROM_XYZ = (
    (3.2404542, -1.5371385, -0.4985314),
    (-0.9692660, 1.8760108, 0.0415560),
    (0.0556434, -0.2040259, 1.0572252),
)
_WAVELENGTHS = (0.610, 0.550, 0.465)
_SOLAR_ILLUMINANCE = 128.0
_SUN_SAMPLES = 1 << 16


def sun_direction(elevation: float, azimuth: float) -> torch.Tensor:
    """Unit direction, float64 [3], to a sun `elevation` over the horizon; `azimuth` from -z to +x [rad]."""
    level = math.cos(elevation)
    return torch.tensor(
        [level * math.sin(azimuth), math.sin(elevation), -level * math.cos(azimuth)], dtype=torch.float64
    )


def sky_luminance(directions: torch.Tensor, sun: torch.Tensor, turbidity: float) -> torch.Tensor:
    """Linear RGB [..., 3] of the sky in kcd/m² towards unit `directions` with y > 0, without the sun.

    Colours outside sRGB are moved to its border. Below the horizon the horizon's value is continued.
    """
    zenith_angle = math.acos(float(sun[1]))
    cosine = directions[..., 1].clamp_min(1e-2)
    gamma_cosine = (directions @ sun.to(directions)).clamp(-1, 1)
    gamma = torch.acos(gamma_cosine)
    chi = (4 / 9 - turbidity / 120) * (math.pi - 2 * zenith_angle)
    zenith_luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    zenith = (
        zenith_luminance,
        _zenith(_ZENITH_X, turbidity, zenith_angle),
        _zenith(_ZENITH_Y, turbidity, zenith_angle),
    )

    values = []
    for at_zenith, rows in zip(zenith, _PEREZ, strict=True):
        a, b, c, d, e = (slope * turbidity + offset for slope, offset in rows)
        # Perez: F(t, g) = (1 + A exp(B / cos t)) (1 + C exp(D g) + E cos² g), eq. 3 and 4.
        shape = (1 + a * torch.exp(b / cosine)) * (1 + c * torch.exp(d * gamma) + e * gamma_cosine.square())
        own = (1 + a * math.exp(b)) * (1 + c * math.exp(d * zenith_angle) + e * math.cos(zenith_angle) ** 2)
        values.append(at_zenith * shape / own)
    luminance, x, y = values
    luminance = luminance.clamp_min(0)
    tristimulus = torch.stack([luminance * x / y, luminance, luminance * (1 - x - y) / y], dim=-1)
    return (tristimulus @ torch.tensor(_RGB_FROM_XYZ).to(directions).T).clamp_min(0)


def sun_illuminance(elevation: float, turbidity: float) -> torch.Tensor:
    """Linear RGB [3] in klx on a surface that faces the sun: appendix A.1 (Rayleigh and aerosol)."""
    zenith_degrees = 90 - math.degrees(elevation)
    mass = 1 / (math.cos(math.radians(zenith_degrees)) + 0.15 * (93.885 - zenith_degrees) ** -1.253)
    haze = 0.04608 * turbidity - 0.04586
    transmitted = [math.exp(-0.008735 * mass * w**-4.08) * math.exp(-haze * mass * w**-1.3) for w in _WAVELENGTHS]
    return _SOLAR_ILLUMINANCE * torch.tensor(transmitted, dtype=torch.float64)


def sun_image(height: int, sun: torch.Tensor, irradiance: torch.Tensor) -> torch.Tensor:
    """A map float64 [H, 2 H, 3] with the sun's disc alone, spread over texels by the part they cover.

    Its energy over the sphere is `irradiance` [3] at every resolution.
    """
    width = 2 * height
    index = torch.arange(_SUN_SAMPLES, dtype=torch.float64)
    # Equal areas of the spherical cap along a golden spiral.
    cosine = 1 - (1 - math.cos(SUN_RADIUS)) * (index + 0.5) / _SUN_SAMPLES
    turn = index * (math.pi * (3 - math.sqrt(5)))
    sine = (1 - cosine.square()).sqrt()
    helper = torch.tensor([1.0, 0, 0] if abs(float(sun[0])) < 0.9 else [0, 1.0, 0], dtype=torch.float64)
    one = torch.nn.functional.normalize(torch.linalg.cross(sun, helper), dim=0)
    two = torch.linalg.cross(sun, one)
    points = (sine * turn.cos())[:, None] * one + (sine * turn.sin())[:, None] * two + cosine[:, None] * sun
    row = (torch.acos(points[:, 1].clamp(-1, 1)) / math.pi * height).long().clamp(0, height - 1)
    around = torch.atan2(points[:, 0], -points[:, 2]) / (2 * math.pi) + 0.5
    column = (around * width).long() % width
    share = torch.zeros(height * width, dtype=torch.float64)
    share.index_add_(0, row * width + column, torch.full_like(index, 1 / _SUN_SAMPLES))
    share = share.reshape(height, width) / sh.row_weights(height, width)[:, None]
    return share[..., None] * irradiance


def _zenith(rows: tuple, turbidity: float, angle: float) -> float:
    powers = (angle**3, angle**2, angle, 1.0)
    weights = (turbidity**2, turbidity, 1.0)
    return sum(w * sum(c * p for c, p in zip(row, powers, strict=True)) for w, row in zip(weights, rows, strict=True))
