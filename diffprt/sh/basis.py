"""The real spherical harmonic basis as polynomials in x, y, z (conventions: `diffprt.sh`).

y_lm = P_l^|m|(z) A_m(x, y) for m >= 0 and P_l^|m|(z) B_|m|(x, y) for m < 0, where A_m + i B_m = (x + iy)^m
and P_l^m is the normalised associated Legendre function without its factor (1 - z²)^(m/2), which A and B
carry. Nothing is divided by sin θ and no angle is ever formed, so values and gradients are finite at the
poles.

Source: Sloan, "Efficient Spherical Harmonic Evaluation" (JCGT 2013), with the recurrence tabulated, not
unrolled.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import torch

from diffprt.errors import InputError
from diffprt.options.ranges import MAXIMUM_ORDER, check_order

# Of products of two lights or transfers.
PRODUCT_ORDER = 2 * MAXIMUM_ORDER - 1


class RecurrenceTables(NamedTuple):
    """Constants of the Legendre recurrence, shared by `basis` and by kernels. See `recurrence_tables`."""

    diagonal: torch.Tensor
    a: torch.Tensor
    b: torch.Tensor


def coefficient_count(order: int) -> int:
    """K = order². Raises InputError for an order outside 1..10."""
    return check_order(order) ** 2


def order_of_count(count: int, *, most: int = MAXIMUM_ORDER) -> int:
    """The order whose coefficient count is `count`. Raises InputError if `count` is not 1, 4, 9, ... `most`²."""
    order = math.isqrt(max(int(count), 0))
    if order * order != count or not 1 <= order <= most:
        raise InputError(
            f"{count} SH coefficients are not order² of an order in 1..{most}: give 1, 4, 9, ... {most**2}"
        )
    return order


def band_of_index(order: int) -> torch.Tensor:
    """Band l of each coefficient, int64 [K]: 0, 1, 1, 1, 2, ... InputError for an order outside 1..10."""
    return torch.tensor([l for l in range(check_order(order)) for _ in range(2 * l + 1)])


@lru_cache(maxsize=PRODUCT_ORDER)
def _recurrence(order: int) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """The tables of `recurrence_tables` as Python floats."""
    diagonal = [math.sqrt(1 / (4 * math.pi))]
    for m in range(1, order):
        # The first step from m = 0 brings in the √2 of the real basis; every step brings in one sign.
        diagonal.append(-diagonal[-1] * math.sqrt((2 * m + 1) / (2 * m) * (2 if m == 1 else 1)))
    a, b = [0.0] * order**2, [0.0] * order**2
    for l in range(1, order):
        for m in range(l):
            scale = math.sqrt((4 * l * l - 1) / (l * l - m * m))
            a[l * (l + 1) + m] = scale
            b[l * (l + 1) + m] = (
                scale * math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1)) if m < l - 1 else 0.0
            )
    return tuple(diagonal), tuple(a), tuple(b)


def recurrence_tables(order: int, dtype: torch.dtype = torch.float64) -> RecurrenceTables:
    """Constants from which y_lm follows, for kernels that must agree with `basis`.

    For m = 0..order-1, with P the Legendre factor of this file's heading:

        P_m^m = diagonal[m]                                          (a constant)
        P_l^m = a[i] z P_{l-1}^m - b[i] P_{l-2}^m,   i = l(l+1)+m,   l = m+1..order-1, where P_{m-1}^m = 0

        A_0 = 1, B_0 = 0,   A_{m+1} = x A_m - y B_m,   B_{m+1} = x B_m + y A_m
        y[l(l+1)+m] = P_l^m A_m (m >= 0),   y[l(l+1)-m] = P_l^m B_m (m > 0)

    The sign (-1)^m and the √2 of m > 0 are in `diagonal`.

    Args:
        order: 1..19; beyond 10 for products.
        dtype: floating dtype of the tables; found in float64.
    Returns:
        `diagonal` [order], `a` [K] and `b` [K], K = order². Entries of `a` and `b` with m < 0 or m = l are 0
        and not used; `b` is 0 at l = m + 1.
    Raises:
        InputError: order outside 1..19.
    """
    tables = _recurrence(check_order(order, most=PRODUCT_ORDER))
    return RecurrenceTables(*(torch.tensor(table, dtype=dtype) for table in tables))


def legendre(z: torch.Tensor, order: int) -> dict[tuple[int, int], torch.Tensor]:
    """P_l^m(z), for all 0 <= m <= l < order, by (l, m): each of the shape of `z`, gradients included."""
    diagonal, a, b = _recurrence(order)
    table = {}
    for m in range(order):
        below, current = None, torch.full_like(z, diagonal[m])
        table[m, m] = current
        for l in range(m + 1, order):
            i = l * (l + 1) + m
            above = a[i] * z * current if below is None else a[i] * z * current - b[i] * below
            below, current = current, above
            table[l, m] = current
    return table


def basis(directions: torch.Tensor, order: int) -> torch.Tensor:
    """All y_lm of order `order` at `directions`.

    Args:
        directions: float [..., 3], any floating dtype, unit length. Not normalised here: the polynomials are
            evaluated at what is given, so a length of 1 + 1e-7 changes values by about l * 1e-7 and never by
            NaN.
        order: 1..19; beyond 10 for products.
    Returns:
        [..., K] of the dtype of `directions`. Gradients reach `directions`; they are those of the polynomial
        extension, of which only the part tangential to the sphere has a meaning.
    Raises:
        InputError: order outside 1..19; `directions` not floating point or without a last axis of 3.
    """
    order = check_order(order, most=PRODUCT_ORDER)
    if not directions.is_floating_point() or directions.shape[-1:] != (3,):
        raise InputError(f"directions are {directions.dtype} {list(directions.shape)}: give floating-point [..., 3]")
    x, y, z = directions.unbind(-1)
    table = legendre(z, order)
    columns: list[torch.Tensor] = [torch.empty(0)] * order**2
    cosine, sine = torch.ones_like(x), torch.zeros_like(x)
    for m in range(order):
        for l in range(m, order):
            columns[l * (l + 1) + m] = table[l, m] * cosine
            if m > 0:
                columns[l * (l + 1) - m] = table[l, m] * sine
        cosine, sine = x * cosine - y * sine, x * sine + y * cosine
    return torch.stack(columns, dim=-1)


def evaluate(coefficients: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
    """The band-limited function Σ c_k y_k(d).

    Args:
        coefficients: float [K] or [K, ...], K = order².
        directions: float [..., 3], unit length.
    Returns:
        The leading axes of `directions` followed by the trailing axes of `coefficients`, in the wider of the
        two dtypes. Gradients reach both.
    Raises:
        InputError: K is not order² of an order in 1..10, or `directions` is not [..., 3].
    """
    values = basis(directions, order_of_count(coefficients.shape[0] if coefficients.dim() else 0))
    dtype = torch.promote_types(values.dtype, coefficients.dtype)
    return torch.tensordot(values.to(dtype), coefficients.to(dtype), dims=1)
