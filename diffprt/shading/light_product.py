"""The product of transfer and light, the first step of all shading."""

from __future__ import annotations

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene import Light


def light_coefficients(light: Light | torch.Tensor, order: int) -> torch.Tensor:
    """Coefficients [K, 3] of a light of the given order.

    Raises:
        InputError: the light has another order, or not three colors.
    """
    coefficients = light.coefficients if isinstance(light, Light) else light
    if coefficients.dim() != 2 or coefficients.shape[1] != 3:
        raise InputError(f"light has shape {list(coefficients.shape)}: give SH coefficients of RGB, [{order**2}, 3]")
    if len(coefficients) != order**2:
        raise InputError(
            f"transfer has {order**2} SH coefficients, light has {len(coefficients)}: "
            f"project the light with order={order}, or bake with order={sh.order_of_count(len(coefficients))}"
        )
    return coefficients


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
