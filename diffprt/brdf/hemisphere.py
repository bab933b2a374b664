"""Integrals of spherical harmonics over the upper hemisphere, exact by Gauss rules.

They commute with turns about the normal and with mirror images, as isotropic BRDFs do. Such a matrix joins y_lm and
y_l'm alone, with the same value for m and -m: it is one small block per m >= 0.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt.sh.basis import PRODUCT_ORDER, check_order, legendre


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


def polar_harmonics(angle: torch.Tensor, order: int, count: int) -> torch.Tensor:
    """y_lm at polar `angle` [...] and azimuth 0, for m = 0..count-1: [..., count, order], 0 where l < m."""
    table, sine = legendre(angle.cos(), order), angle.sin()
    zero = torch.zeros_like(angle)
    rows = [[table[l, m] * sine**m if l >= m else zero for l in range(order)] for m in range(count)]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def from_blocks(blocks: torch.Tensor, order_out: int, order_in: int) -> torch.Tensor:
    """The matrix [..., K_out, K_in] of blocks [..., m, order_out, order_in], m = 0..min(orders)-1."""
    rows, columns, source = [], [], []
    for m in range(min(order_out, order_in)):
        for l in range(m, order_out):
            for k in range(m, order_in):
                for sign in {m, -m}:
                    rows.append(l * (l + 1) + sign)
                    columns.append(k * (k + 1) + sign)
                    source.append((m * order_out + l) * order_in + k)
    full = blocks.new_zeros(*blocks.shape[:-3], order_out**2 * order_in**2)
    places = torch.tensor(rows) * order_in**2 + torch.tensor(columns)
    full = full.index_copy(-1, places, blocks.flatten(-3)[..., torch.tensor(source)])
    return full.unflatten(-1, (order_out**2, order_in**2))
