"""The sRGB transfer curve (IEC 61966-2-1), from display-encoded to linear."""

from __future__ import annotations

import torch


def linear_from_srgb(encoded: torch.Tensor) -> torch.Tensor:
    """Linear values of sRGB-encoded ones in [0, 1], any shape; other values follow the same curve."""
    return torch.where(encoded <= 0.04045, encoded / 12.92, ((encoded.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)
