"""Integrals of spherical harmonics over the upper hemisphere, exact by Gauss rules."""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt.brdf.blocks import from_blocks, polar_harmonics
from diffprt.sh.basis import PRODUCT_ORDER, check_order


def hemisphere_moments(order: int, *, cosine: bool) -> torch.Tensor:
    """∫ y_k, times cos θ if `cosine`, over the upper hemisphere: float64 [K], zonal."""
    angle, weight = _rule(order, cosine)
    moments = torch.zeros(order**2, dtype=torch.float64)
    bands = torch.arange(check_order(order, most=PRODUCT_ORDER))
    moments[bands * (bands + 1)] = 2 * math.pi * weight @ polar_harmonics(angle, order, 1)[:, 0]
    return moments


def hemisphere_gram(order: int, *, cosine: bool) -> torch.Tensor:
    """∫ y_i y_j, times cos θ if `cosine`, over the upper hemisphere: float64 [K, K]."""
    angle, weight = _rule(order, cosine)
    rows = polar_harmonics(angle, check_order(order, most=PRODUCT_ORDER), order)
    around = torch.full((order,), math.pi, dtype=torch.float64)
    around[0] = 2 * math.pi
    return from_blocks(torch.einsum("q,qml,qmk,m->mlk", weight, rows, rows, around), order, order)


def _rule(order: int, cosine: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """Polar angles and weights [Q] that are exact for two harmonics of `order`."""
    z, weight = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(order + 1))
    z, weight = (z + 1) / 2, weight / 2
    return z.acos(), weight * z if cosine else weight
