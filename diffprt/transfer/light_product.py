"""The product of transfer and light, the first step of all shading."""

from __future__ import annotations

import torch


def under_light(signal: torch.Tensor, coefficients: torch.Tensor) -> torch.Tensor:
    """Matrices that act on light, applied to it; one channel serves all three colors.

    Args:
        signal: float [..., C, K_out, K].
        coefficients: float [K, 3], turned into the signal's dtype.

    Returns:
        [..., 3, K_out]. Gradients reach both.
    """
    coefficients = coefficients.to(signal.dtype)
    if signal.shape[-3] == 1:
        return (signal[..., 0, :, :] @ coefficients).transpose(-1, -2)
    return torch.einsum("...cok,kc->...co", signal, coefficients)
