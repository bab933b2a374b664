"""The least-squares description of a BRDF in spherical harmonics, above the surface only.

Below the surface neither light nor exit radiance is asked for. A projection that puts 0 there must spend its bands on
the step at the horizon. Here the series of rho, without cosine, is instead the one with the least error

    ∫∫ cos θ_o cos θ_i (rho(w_i, w_o) - Σ b_oi y_o(w_o) y_i(w_i))² dw_o dw_i

over both upper hemispheres: b = G_o⁻¹ A G_i⁻¹, with A from `brdf_matrix(..., exit_cosine=True)` and G the Gram matrix
under the cosine. Radiance from a surface is seen in proportion to cos θ_o, and light arrives in proportion to
cos θ_i, so this is the error in pictures. What follows from it:

- A Lambertian BRDF is exact at every order.
- The flux that leaves is exact at every order: the residual is orthogonal to the constant.
- Without shadows, exit radiance is the best one for any light of the incident order, as if b had no truncation.

G is nearly singular, because functions that live below the horizon cost nothing. On the exit side, where coefficients
are stored, compressed and interpolated, `ridge` times their square (band 0 apart) is added to the error.
"""

from __future__ import annotations

import torch

from diffprt.brdf.hemisphere import hemisphere_gram
from diffprt.brdf.interface import Brdf
from diffprt.brdf.matrix import brdf_matrix
from diffprt.errors import InputError


def fitted_matrix(brdf: Brdf, order_out: int, order_in: int, *, ridge: float = 3e-4) -> torch.Tensor:
    """Coefficients b of the BRDF above the surface, without cosine.

    Args:
        brdf: what reflects.
        order_out, order_in: of exit radiance and of incident light.
        ridge: >= 0, weight of the square of the exit coefficients.

    Returns:
        float64 [C, K_out, K_in]. Gradients reach the BRDF's parameters.

    Raises:
        InputError: an order out of range, or a negative ridge.
    """
    moments = brdf_matrix(brdf, order_out, order_in, exit_cosine=True)
    return exit_fit(order_out, ridge=ridge) @ torch.linalg.solve(
        hemisphere_gram(order_in, cosine=True), moments, left=False
    )


def exit_fit(order: int, *, ridge: float = 3e-4) -> torch.Tensor:
    """From the moments ∫ y_k cos θ f over the upper hemisphere to the coefficients of f: float64 [K, K]."""
    if not ridge >= 0:
        raise InputError(f"ridge is {ridge}: give 0 or more")
    penalty = torch.full((order**2,), float(ridge), dtype=torch.float64)
    penalty[0] = 0.0
    return torch.linalg.inv(hemisphere_gram(order, cosine=True) + torch.diag(penalty))
