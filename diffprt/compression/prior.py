"""What lights weigh: real environments hold far more power in low bands, so errors there cost more."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from diffprt import sh
from diffprt.errors import InputError


def light_prior(lights: Sequence[torch.Tensor]) -> torch.Tensor:
    """Mean square of the coefficients in each band over several lights, each scaled to unit power.

    The squared error of radiance under a random light of this prior, turned at random, is the squared error of
    transfer with every coefficient weighted by its entry.

    Args:
        lights: float [K, C] each, such as `Light.coefficients`.

    Returns:
        float64 [K], with mean 1.

    Raises:
        InputError: there are no lights, they differ in order, or one is black.
    """
    if not lights or len({len(light) for light in lights}) != 1:
        raise InputError(f"a prior of {len(lights)} lights: give 1 or more, all of the same order")
    order = sh.order_of_count(len(lights[0]))
    power = torch.zeros(order, dtype=torch.float64)
    band = sh.band_of_index(order)
    for light in lights:
        square = light.detach().double().square().mean(1)
        if not float(square.sum()) > 0:
            raise InputError("a light of the prior is black: give lights that shine")
        power += torch.zeros_like(power).index_add_(0, band, square / square.sum())
    prior = (power / torch.bincount(band, minlength=order))[band]
    return prior / prior.mean()


def check_prior(prior: torch.Tensor, coefficients: int) -> torch.Tensor:
    """The prior as float64 [K] with mean 1.

    Raises:
        InputError: it is of another length, or not all positive.
    """
    prior = torch.as_tensor(prior, dtype=torch.float64)
    if tuple(prior.shape) != (coefficients,):
        raise InputError(f"prior has shape {list(prior.shape)}, the transfer {coefficients} coefficients: give as many")
    if not bool(torch.isfinite(prior).all() and (prior > 0).all()):
        raise InputError("prior has entries that are not above 0: give the mean square of each light coefficient")
    return prior / prior.mean()
