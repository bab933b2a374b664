"""The product of transfer and light, the first step of all shading."""

from __future__ import annotations

import torch


def under_light(signal: torch.Tensor, coefficients: torch.Tensor) -> torch.Tensor:
    """Matrices that act on light, applied to it; one channel serves all three colors.

    Args:
        signal: float [..., C, K_out, K].
        coefficients: float [K, 3], turned into the signal's dtype; or of a batch of B lights, [B, K, 3].

    Returns:
        [..., 3, K_out]; of a batch [..., 3 B, K_out], the colors of each light in turn. Gradients reach both.
    """
    coefficients = coefficients.to(signal.dtype)
    if coefficients.dim() == 3:
        if signal.shape[-3] == 1:
            return (signal[..., 0, :, :] @ coefficients.transpose(0, 1).flatten(1)).transpose(-1, -2)
        return torch.einsum("...cok,bkc->...bco", signal, coefficients).flatten(-3, -2)
    if signal.shape[-3] == 1:
        return (signal[..., 0, :, :] @ coefficients).transpose(-1, -2)
    return torch.einsum("...cok,kc->...co", signal, coefficients)
