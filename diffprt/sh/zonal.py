"""Zonal harmonics: functions symmetric about an axis, turned and convolved.

Zonal coefficients are [order], entry l being ∫ f y_l0 for the function about +z (conventions: `diffprt.sh`).
"""

from __future__ import annotations

import math

import torch

from diffprt.errors import InputError
from diffprt.sh.basis import basis, check_order, order_of_count


def clamped_cosine(order: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """Zonal coefficients of max(cos θ, 0), without 1/π: 0.886227, 1.023327, 0.495416, 0, -0.110778, 0,
    0.049927, ...

    Args:
        order: 1..10.
        dtype: floating dtype of the result; the closed form is found in float64.
    Returns:
        [order].
    Raises:
        InputError: order outside 1..10.

    Source: Ramamoorthi and Hanrahan, SIGGRAPH 2001, eq. 8, times √((2l+1)/4π).
    """
    values = []
    for l in range(check_order(order)):
        if l == 1:
            transfer = 2 * math.pi / 3
        elif l % 2 == 1:
            transfer = 0.0
        else:
            sign = -1 if l % 4 == 0 else 1
            transfer = 2 * math.pi * sign * math.comb(l, l // 2) / ((l + 2) * (l - 1) * 2**l)
        values.append(transfer * math.sqrt((2 * l + 1) / (4 * math.pi)))
    return torch.tensor(values, dtype=dtype)


def cap(half_angle: float | torch.Tensor, order: int) -> torch.Tensor:
    """Zonal coefficients of the indicator of a cap: 1 within `half_angle` of the axis, 0 outside.

    Args:
        half_angle: radians, 0 < half_angle <= π. A number, or a float tensor [].
        order: 1..10.
    Returns:
        [order], of the dtype of `half_angle` (float64 for a number). Gradients reach `half_angle`.
    Raises:
        InputError: half_angle outside (0, π], or order outside 1..10.

    ∫_c^1 P_l = (1 - c²) P_l'(c) / (l (l + 1)) is used, from Legendre's equation: unlike the usual difference
    P_{l-1}(c) - P_{l+1}(c) it does not cancel for small caps, such as the sun's.
    """
    order = check_order(order)
    angle = torch.as_tensor(half_angle, dtype=None if torch.is_tensor(half_angle) else torch.float64)
    if angle.dim() != 0 or not 0 < float(angle.detach()) <= math.pi * (1 + 1e-7):
        raise InputError(f"half angle {half_angle} is outside (0, π] radians: give an angle in radians")
    cosine, sine_squared = angle.cos(), angle.sin() ** 2
    areas = [4 * math.pi * (angle / 2).sin() ** 2]
    legendre = [torch.ones_like(angle), cosine]
    slopes = [torch.zeros_like(angle), torch.ones_like(angle)]
    for l in range(1, order):
        areas.append(2 * math.pi * sine_squared * slopes[l] / (l * (l + 1)))
        legendre.append(((2 * l + 1) * cosine * legendre[l] - l * legendre[l - 1]) / (l + 1))
        slopes.append(slopes[l - 1] + (2 * l + 1) * legendre[l])
    norms = [math.sqrt((2 * l + 1) / (4 * math.pi)) for l in range(order)]
    return torch.stack([area * norm for area, norm in zip(areas, norms, strict=True)])


def _band_scale(zonal: torch.Tensor) -> torch.Tensor:
    """√(4π/(2l+1)) z_l spread over the K coefficients of the bands."""
    if zonal.dim() != 1:
        raise InputError(f"zonal coefficients have shape {list(zonal.shape)}: give one per band, [order]")
    order = check_order(zonal.shape[0])
    widths = 2 * torch.arange(order, device=zonal.device) + 1
    scaled = zonal * (4 * torch.pi / widths.double()).sqrt().to(zonal.dtype)
    return scaled.repeat_interleave(widths)


def rotate_zonal(zonal: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
    """Coefficients of a zonal function with its axis turned to each of `directions`.

    Args:
        zonal: float [order], order 1..10.
        directions: float [..., 3], unit length.
    Returns:
        [..., K] in the wider dtype. Gradients reach both.
    Raises:
        InputError: `zonal` not [order] with order in 1..10, or `directions` not [..., 3].

    Source: the addition theorem: a zonal function about d has √(4π/(2l+1)) z_l y_lm(d).
    """
    scale = _band_scale(zonal)
    return basis(directions, zonal.shape[0]) * scale


def convolve(coefficients: torch.Tensor, zonal: torch.Tensor) -> torch.Tensor:
    """Convolution with a zonal kernel, (f * h)(d) = ∫ f(w) h(angle between w and d) dw.

    With `clamped_cosine` it turns radiance into irradiance [W/m²] by normal.

    Args:
        coefficients: float [K] or [K, ...], K = order².
        zonal: float [order], the same order.
    Returns:
        The shape of `coefficients`, in the wider dtype. Gradients reach both.
    Raises:
        InputError: orders that differ or lie outside 1..10.

    Source: Funk-Hecke theorem; Ramamoorthi and Hanrahan, SIGGRAPH 2001, eq. 7.
    """
    order = order_of_count(coefficients.shape[0] if coefficients.dim() else 0)
    scale = _band_scale(zonal)
    if zonal.shape[0] != order:
        raise InputError(f"coefficients have order {order}, zonal kernel has {zonal.shape[0]}: give one order")
    return coefficients * scale.reshape(-1, *[1] * (coefficients.dim() - 1))
