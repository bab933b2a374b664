"""Windows against ringing: factors per band, fixed or just strong enough to leave nothing negative.

Sources: Sloan, "Stupid Spherical Harmonics Tricks" (GDC 2008) for the fixed windows; Sloan, "Deringing
Spherical Harmonics" (SIGGRAPH Asia 2017 briefs) for searching the least strength. The automatic family is the
heat kernel exp(-s l (l + 1)), which is non-negative on the sphere: blurring by it can only raise the minimum,
so more strength is never worse and bisection finds the least that suffices. (A squared-Laplacian penalty 1/(1
+ s l² (l + 1)²) has no such guarantee and costs more: for a directional light of order 6 it keeps 8 % of the
peak, the heat kernel 13 %.)
"""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.sh.basis import band_of_index, check_order, evaluate, order_of_count
from diffprt.sh.extrema import ROWS_PER_BAND, sphere_minimum
from diffprt.sh.maps import render_map

WINDOWS = ("none", "hann", "lanczos", "auto")
# Accepted negative remainder of the automatic window, relative to the peak.
TOLERANCE = 1e-11
ROUNDS = 16


def window(name: str, order: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """Factors [order], one per band, of a fixed window; band 0 has 1 and band `order` would have 0.

    "none" is 1, "hann" is (1 + cos(π l / order)) / 2, "lanczos" is sin(π l / order) / (π l / order). "auto"
    depends on the function: see `apply_window`.

    Raises:
        InputError: unknown name, "auto", or order outside 1..10.
    """
    bands = torch.arange(check_order(order), dtype=torch.float64)
    match name:
        case "none":
            factors = torch.ones_like(bands)
        case "hann":
            factors = 0.5 + 0.5 * torch.cos(torch.pi * bands / order)
        case "lanczos":
            factors = torch.sinc(bands / order)
        case "auto":
            raise InputError("window 'auto' depends on the light: use apply_window, or a fixed window such as 'hann'")
        case _:
            raise InputError(f"unknown window {name!r}: choose one of {', '.join(WINDOWS)}")
    return factors.to(dtype)


def apply_window(coefficients: torch.Tensor, name: str) -> tuple[torch.Tensor, dict]:
    """Window a function, and report what it gains and costs.

    "auto" scales band l by exp(-s l (l + 1)) with the least s >= 0 for which the function is nowhere
    negative, in any channel; one s for all channels, so hues do not shift. A function that does not ring is
    left as it is.

    Args:
        coefficients: float [K] or [K, C], K = order².
        name: "none", "hann", "lanczos" or "auto".
    Returns:
        Windowed coefficients, of the same shape and dtype, and a report of plain numbers: `window`,
        `strength` (s, or None for a fixed window), `factors` (one per band), `minimum_before`,
        `minimum_after`, `peak_before`, `peak_after` (over the sphere and all channels), `contrast` (peak
        after / before), `contrast_cost` (1 - contrast), `energy_kept` (share of Σ c²). The report carries no
        gradient. Gradients reach `coefficients`, for "auto" also through s (implicit function theorem at the
        direction of the minimum).
    Raises:
        InputError: unknown name; coefficients not finite or not [K] or [K, C]; "auto" on a channel whose mean
            is negative, or zero while the rest is not, which no window can mend.
    """
    if name == "picture":
        raise InputError(
            "window 'picture' depends on the asset: use diffprt.rendering.PictureWindow, or a window such as 'none'"
        )
    if name not in WINDOWS:
        raise InputError(f"unknown window {name!r}: choose one of {', '.join(WINDOWS)}")
    if coefficients.dim() not in (1, 2) or not coefficients.is_floating_point():
        raise InputError(
            f"coefficients are {coefficients.dtype} {list(coefficients.shape)}: give floating [K] or [K, C]"
        )
    order = order_of_count(coefficients.shape[0])
    matrix = coefficients.reshape(order * order, -1).double()
    minimum_before = sphere_minimum(matrix)[0]
    peak_before = -sphere_minimum(-matrix)[0]
    strength = _least_strength(matrix, order) if name == "auto" else None
    factors = (window(name, order) if strength is None else _heat(strength, order)).to(matrix.device)
    windowed = factors[band_of_index(order).to(matrix.device)][:, None] * matrix
    plain, before = windowed.detach(), matrix.detach()
    peak_after = -sphere_minimum(-plain)[0]
    contrast = peak_after / peak_before if peak_before else 1.0
    energy = float(before.square().sum())
    report = {
        "window": name,
        "strength": None if strength is None else float(strength.detach()),
        "factors": factors.tolist(),
        "minimum_before": minimum_before,
        "minimum_after": sphere_minimum(plain)[0],
        "peak_before": peak_before,
        "peak_after": peak_after,
        "contrast": contrast,
        "contrast_cost": 1.0 - contrast,
        "energy_kept": float(plain.square().sum()) / energy if energy else 1.0,
    }
    return windowed.reshape(coefficients.shape).to(coefficients.dtype), report


def _heat(strength: torch.Tensor, order: int) -> torch.Tensor:
    bands = torch.arange(order, dtype=torch.float64, device=strength.device)
    return torch.exp(-strength * bands * (bands + 1))


def _least_strength(matrix: torch.Tensor, order: int) -> torch.Tensor:
    """Least s of the heat window that leaves [K, C] non-negative, with its gradient; zero without ringing.

    An exchange method: bisect over a set of directions, search the whole sphere for the minimum that the set
    missed, add it to the set, repeat. The set grows by a few directions only.
    """
    values = matrix.detach()
    empty = (values[0] <= 0) & (values.abs().amax(0) > 0)
    if bool(empty.any()):
        channel = int(empty.nonzero()[0])
        mean = float(values[0, channel]) / (4 * torch.pi) ** 0.5
        raise InputError(
            f"channel {channel} has mean {mean:.3g}, want above 0: no window makes it non-negative; "
            "clamp negative texels before projecting"
        )
    bands = band_of_index(order).to(values.device)
    height = ROWS_PER_BAND * order
    one_hot = torch.nn.functional.one_hot(bands, order).double()
    split = (values[:, None, :] * one_hot[:, :, None]).reshape(order * order, -1)  # [K, order * C]
    profile = render_map(split, height, 2 * height).reshape(-1, order, values.shape[1])
    strength, scale = values.new_zeros(()), float(values.abs().max())
    for _ in range(ROUNDS):
        lowest, direction, channel = sphere_minimum(values * _heat(strength, order)[bands][:, None])
        if lowest >= -TOLERANCE * scale:
            break
        profile = torch.cat([profile, evaluate(split, direction).reshape(1, order, -1)])
        strength = _bisect(profile, order)
    if float(strength) == 0.0 or not matrix.requires_grad:
        return strength
    # One Newton step of s on f(direction; s) = 0: no change in value, and ds/dc = -(∂f/∂c) / (∂f/∂s).
    weights = (_heat(strength, order)[bands] * evaluate(torch.eye(order**2).to(values), direction)).detach()
    slope = float((-(bands * (bands + 1)) * weights * values[:, channel]).sum())
    residual = (weights * matrix[:, channel]).sum()
    return strength - (residual - residual.detach()) / slope


def _bisect(profile: torch.Tensor, order: int) -> torch.Tensor:
    """Least s for which functions given by band, [D, order, C], are all non-negative at their directions."""

    def negative(strength: torch.Tensor) -> bool:
        return bool(torch.einsum("l,dlc->dc", _heat(strength, order), profile).min() < 0)

    low, high = profile.new_zeros(()), profile.new_ones(())
    while negative(high):
        low, high = high, 2 * high
    while float(high - low) > 1e-15 * float(high):
        middle = (low + high) / 2
        if not float(low) < float(middle) < float(high):
            break
        low, high = (middle, high) if negative(middle) else (low, middle)
    return high
