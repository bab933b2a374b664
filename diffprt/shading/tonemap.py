"""From linear radiance to display values. The exported shader runs this same arithmetic."""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.options import CURVES


def tone_map(radiance: torch.Tensor, *, exposure: float | torch.Tensor = 1.0, curve: str = "linear") -> torch.Tensor:
    """Display values in [0, 1], sRGB-encoded; differentiable to radiance and exposure.

    Args:
        radiance: [..., 3], linear; negative values become 0.
        exposure: factor on radiance.
        curve: "linear" clips; "reinhard" is x / (1 + x); "aces" is Narkowicz's fit (2015) of the ACES curve.
    """
    x = (radiance * exposure).clamp_min(0.0)
    if curve == "reinhard":
        x = x / (1.0 + x)
    elif curve == "aces":
        x = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    elif curve != "linear":
        raise InputError(f"tone curve '{curve}' is unknown: use one of {', '.join(CURVES)}")
    return srgb_encode(x.clamp(0.0, 1.0))


def srgb_encode(linear: torch.Tensor) -> torch.Tensor:
    """IEC 61966-2-1 transfer function of values in [0, 1]; its gradient is finite at 0."""
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
