"""Rotation of coefficients by the recurrence of Ivanic and Ruedenberg.

Source: Ivanic and Ruedenberg, "Rotation Matrices for Real Spherical Harmonics. Direct Determination by
Recursion" (J. Phys. Chem. 1996, table 1) with the corrections of 1998. Their table gives each entry (m, n) of
band l as u U + v V + w W, sums of products of one entry of band 1 and one of band l - 1. All of u, v, w share
the denominator, which depends on n alone, so the whole table is one bilinear map

    D_l = Σ_ij D_1[i, j] · S_i · D_{l-1} · C_j

with constant sparse S (the u, v, w over rows) and C (the choice of columns and the denominator). It is a
polynomial in the entries of R: smooth everywhere, with no Euler angles to degenerate at β = 0 or π.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import torch

from diffprt.errors import InputError
from diffprt.sh.basis import check_order, order_of_count

ORTHOGONALITY_TOLERANCE = 1e-4
# Axes of band 1 for m = -1, 0, 1, and the Condon-Shortley signs that the 1996 paper leaves out.
BAND_ONE_AXES = (1, 2, 0)
BAND_ONE_SIGNS = (-1.0, 1.0, -1.0)


@lru_cache(maxsize=16)
def _band_tables(l: int) -> tuple[torch.Tensor, torch.Tensor]:
    """S [3, 2l+1, 2l-1] and C [3, 2l-1, 2l+1] of band l >= 2 in float64, both in the Condon-Shortley sign."""
    rows = torch.zeros(3, 2 * l + 1, 2 * l - 1, dtype=torch.float64)
    columns = torch.zeros(3, 2 * l - 1, 2 * l + 1, dtype=torch.float64)

    def add(i: int, m: int, mu: int, value: float) -> None:
        if value:  # a zero factor goes with a neighbour mu outside band l - 1
            rows[i + 1, m + l, mu + l - 1] += value

    for m in range(-l, l + 1):
        u = sqrt((l + m) * (l - m))
        v = sqrt((2 if m == 0 else 1) * (l + abs(m) - 1) * (l + abs(m))) / 2 * (-1 if m == 0 else 1)
        w = -sqrt(max((l - abs(m) - 1) * (l - abs(m)), 0)) / 2 if m else 0.0
        add(0, m, m, u)
        if m == 0:
            add(1, m, 1, v)
            add(-1, m, -1, v)
        elif m > 0:
            add(1, m, m - 1, v * (sqrt(2) if m == 1 else 1))
            add(-1, m, 1 - m, 0.0 if m == 1 else -v)
            add(1, m, m + 1, w)
            add(-1, m, -m - 1, w)
        else:
            add(1, m, m + 1, 0.0 if m == -1 else v)
            add(-1, m, -m - 1, v * (sqrt(2) if m == -1 else 1))
            add(1, m, m - 1, w)
            add(-1, m, 1 - m, -w)

    for n in range(1 - l, l):
        columns[1, n + l - 1, n + l] = 1 / sqrt((l + n) * (l - n))
    edge = 1 / sqrt(2 * l * (2 * l - 1))
    columns[2, -1, -1], columns[0, 0, -1] = edge, -edge
    columns[2, 0, 0], columns[0, -1, 0] = edge, edge

    def sign(band: int) -> torch.Tensor:
        return (-1.0) ** torch.arange(-band, band + 1, dtype=torch.float64).abs()

    outer, inner, first = sign(l), sign(l - 1), sign(1)[:, None, None]
    return rows * first * outer[:, None] * inner, columns * first * inner[:, None] * outer


def _check_rotation(rotation: torch.Tensor) -> None:
    if tuple(rotation.shape) != (3, 3) or not rotation.is_floating_point():
        raise InputError(f"rotation is {rotation.dtype} {list(rotation.shape)}: give a floating-point matrix [3, 3]")
    matrix = rotation.detach().double()
    error = float((matrix.T @ matrix - torch.eye(3, dtype=matrix.dtype, device=matrix.device)).abs().max())
    if not error <= ORTHOGONALITY_TOLERANCE:
        raise InputError(
            f"rotation is not orthonormal (RᵀR differs from the identity by {error:.3g}, want at most "
            f"{ORTHOGONALITY_TOLERANCE:g}): remove scale and shear, e.g. by a QR decomposition"
        )


def rotation_matrices(rotation: torch.Tensor, order: int) -> list[torch.Tensor]:
    """Blocks D_l with c'_l = D_l c_l, for the function L'(d) = L(Rᵀ d).

    Args:
        rotation: float [3, 3], any floating dtype, orthonormal to 1e-4. A reflection (determinant -1) is
            accepted and obeys the same law, which is how a left-handed map is mirrored.
        order: 1..10.
    Returns:
        `order` tensors [2l+1, 2l+1] of the dtype of `rotation`. Gradients reach `rotation`; as the matrix
        leaves the orthonormal ones they follow the polynomial extension.
    Raises:
        InputError: `rotation` not a floating [3, 3], not finite or not orthonormal; order outside 1..10.
    """
    order = check_order(order)
    _check_rotation(rotation)
    blocks = [torch.ones(1, 1, dtype=rotation.dtype, device=rotation.device)]
    if order == 1:
        return blocks
    signs = rotation.new_tensor(BAND_ONE_SIGNS)
    axes = list(BAND_ONE_AXES)
    first = rotation[axes][:, axes] * signs[:, None] * signs
    blocks.append(first)
    for l in range(2, order):
        rows, columns = (table.to(first) for table in _band_tables(l))
        # Contract the band-1 matrix with the row tables first: the two products left are small.
        mixed = torch.einsum("ij,iab->jab", first, rows)
        blocks.append(torch.einsum("jab,bc,jcd->ad", mixed, blocks[-1], columns))
    return blocks


def rotation_matrix(rotation: torch.Tensor, order: int) -> torch.Tensor:
    """The blocks of `rotation_matrices` as one block-diagonal matrix [K, K]; same arguments and errors."""
    return torch.block_diag(*rotation_matrices(rotation, order))


def rotate(coefficients: torch.Tensor, rotation: torch.Tensor) -> torch.Tensor:
    """Coefficients of the turned function L'(d) = L(Rᵀ d).

    Args:
        coefficients: float [K] or [K, ...], K = order².
        rotation: float [3, 3], as in `rotation_matrices`.
    Returns:
        The shape and dtype of `coefficients`. Gradients reach both. The power of each band is unchanged.
    Raises:
        InputError: K is not order² of an order in 1..10, or `rotation` is not an orthonormal [3, 3].
    """
    order = order_of_count(coefficients.shape[0] if coefficients.dim() else 0)
    bands = coefficients.split([2 * l + 1 for l in range(order)])
    blocks = rotation_matrices(rotation, order)
    turned = [torch.tensordot(block.to(coefficients), band, dims=1) for block, band in zip(blocks, bands, strict=True)]
    return torch.cat(turned)
