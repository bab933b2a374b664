"""BRDF matrices by Monte Carlo: the cross-check of the quadrature in `diffprt.brdf.matrix`.

Source: Westin, Arvo and Torrance, "Predicting Reflectance Functions from Complex Surfaces" (SIGGRAPH 1992), section
4, with importance sampling of the BRDF in place of their ray tracer.
"""

from __future__ import annotations

import math

import torch

from diffprt.brdf.interface import Brdf
from diffprt.errors import InputError
from diffprt.sh import basis, check_order

_SAMPLES_PER_BATCH = 1 << 14


def westin_matrix(
    brdf: Brdf, order_out: int, order_in: int, *, samples: int = 1 << 16, generator: torch.Generator | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """An estimate of `brdf_matrix` and its standard error, without gradients.

    Args:
        brdf: what reflects.
        order_out, order_in: of exit radiance and of incident light.
        samples: pairs of directions, at least 2.
        generator: of the random numbers.

    Returns:
        float64 [C, K_out, K_in] each.

    Raises:
        InputError: an order out of range, fewer than 2 samples.
    """
    for order in (order_out, order_in):
        check_order(order)
    if samples < 2:
        raise InputError(f"samples is {samples}: give 2 or more")
    shape = brdf.channels, order_out**2, order_in**2
    total, squares = torch.zeros(shape, dtype=torch.float64), torch.zeros(shape, dtype=torch.float64)
    with torch.no_grad():
        for first in range(0, samples, _SAMPLES_PER_BATCH):
            count = min(_SAMPLES_PER_BATCH, samples - first)
            u = torch.rand(count, 4, dtype=torch.float64, generator=generator)
            radius, angle = (u[:, 0] * (2 - u[:, 0])).sqrt(), 2 * math.pi * u[:, 1]
            outgoing = torch.stack([radius * angle.cos(), radius * angle.sin(), 1 - u[:, 0]], dim=-1)
            incoming = brdf.sample(outgoing, u[:, 2:])
            density = brdf.pdf(incoming, outgoing) / (2 * math.pi)
            weight = brdf.evaluate(incoming, outgoing) * (incoming[:, 2:] / density[:, None])
            rows, columns = basis(outgoing, order_out), basis(incoming, order_in)
            for channel, factor in enumerate(weight.unbind(-1)):
                total[channel] += (rows * factor[:, None]).T @ columns
                squares[channel] += (rows * factor[:, None]).square().T @ columns.square()
    mean = total / samples
    return mean, ((squares / samples - mean**2).clamp_min(0) / samples).sqrt()
