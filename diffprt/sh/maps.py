"""Projection of equirectangular maps to coefficients, and back (map conventions: `diffprt.sh`).

A map is separable in latitude and longitude about +y, while the basis has its pole at +z. So the projection
is done about +y, where each texel's integral of y_lm is a latitude integral times a longitude integral, and
the K coefficients are then turned to the fixed axes by one constant rotation. The cost is H W (2 order - 1)
multiplications, memory is bounded by a block of rows, and a texel is integrated exactly: splitting every
texel in four changes nothing.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.sh.basis import check_order, legendre, order_of_count
from diffprt.sh.rotation import rotation_matrix

# Rows of the matrix are the map's own axes, (x', y', z') = (-z, -x, y): z' is the map's pole and the centre
# column is x'. Longitude p runs from x' towards -y'.
MAP_AXES = ((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
# Gauss nodes per row: exact to rounding for order 10 even when one row spans the whole sphere.
NODES = 24
BLOCK_TEXELS = 1 << 19


def _check_size(height: int, width: int) -> None:
    if height < 1 or width < 1:
        raise InputError(f"map size {height} x {width} has no texels: give height and width of at least 1")


def map_directions(height: int, width: int, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    """Unit directions [H, W, 3] of the texel centres, found in float64 and given in `dtype`.

    Raises:
        InputError: height or width below 1.
    """
    _check_size(height, width)
    polar = torch.pi * (torch.arange(height, dtype=torch.float64) + 0.5) / height
    longitude = 2 * torch.pi * ((torch.arange(width, dtype=torch.float64) + 0.5) / width - 0.5)
    sine, cosine = polar.sin()[:, None], polar.cos()[:, None]
    return torch.stack([sine * longitude.sin(), cosine.expand(-1, width), -sine * longitude.cos()], dim=-1).to(dtype)


def row_weights(height: int, width: int | None = None) -> torch.Tensor:
    """Solid angle [sr] of one texel in each row, float64 [H]: (cos t0 - cos t1) 2π / W, exact.

    Over all texels they sum to 4π, where weights by the sine at the centre overshoot (by 1.0001004 at 64
    rows).

    Args:
        height: rows H >= 1.
        width: columns W; default 2 H.
    Raises:
        InputError: height or width below 1.
    """
    width = 2 * height if width is None else width
    _check_size(height, width)
    centre = torch.pi * (torch.arange(height, dtype=torch.float64) + 0.5) / height
    # cos t0 - cos t1 as a product, which does not cancel in thin rows.
    return 2 * math.sin(math.pi / (2 * height)) * centre.sin() * (2 * torch.pi / width)


@lru_cache(maxsize=10)
def _map_to_fixed(order: int) -> torch.Tensor:
    """Rotation [K, K] from coefficients about the map's axes to those about x, y, z."""
    return rotation_matrix(torch.tensor(MAP_AXES, dtype=torch.float64).T, order)


def _latitudes(polar: torch.Tensor, order: int) -> torch.Tensor:
    """P_l^|m|(cos t) sin^|m| t by coefficient: polar angles [N] to [N, K]."""
    table, sine = legendre(polar.cos(), order), polar.sin()
    columns = [table[l, abs(m)] * sine ** abs(m) for l in range(order) for m in range(-l, l + 1)]
    return torch.stack(columns, dim=-1)


def _row_integrals(height: int, order: int) -> torch.Tensor:
    """Integral of `_latitudes` times sin t over each row, [H, K]."""
    nodes, weights = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(NODES))
    rows = torch.arange(height, dtype=torch.float64)[:, None] + 0.5
    polar = torch.pi / height * (rows + nodes / 2)
    values = _latitudes(polar.reshape(-1), order).reshape(height, NODES, -1)
    return torch.einsum("hgk,hg->hk", values, polar.sin() * weights) * (torch.pi / (2 * height))


def _longitudes(width: int, order: int, *, integrate: bool) -> torch.Tensor:
    """cos m p (m >= 0) and -sin |m| p (m < 0), at column centres or integrated over columns.

    [W, 2 order - 1], m from 1 - order to order - 1.
    """
    step = 2 * torch.pi / width
    longitude = step * (torch.arange(width, dtype=torch.float64) + 0.5) - torch.pi
    m = torch.arange(1 - order, order, dtype=torch.float64)
    # Azimuth about the map's pole is -p, hence the minus of the sines.
    values = torch.where(m >= 0, torch.cos(longitude[:, None] * m), -torch.sin(longitude[:, None] * m.abs()))
    return values * torch.sinc(m * step / (2 * torch.pi)) * step if integrate else values


def _signed_m(order: int) -> torch.Tensor:
    """Place of each coefficient's m among the columns of `_longitudes`, [K]."""
    return torch.tensor([m + order - 1 for l in range(order) for m in range(-l, l + 1)])


def project_map(image: torch.Tensor, order: int) -> torch.Tensor:
    """Project an equirectangular map, each texel a patch of constant radiance.

    Exact for that function: a constant map gives c_00 alone, magnifying a map by repeated texels changes
    nothing, and one texel carries its radiance times its solid angle. A map sampled from a smooth function at
    the centres is off by about l (l + 1) (π/H)² / 24 in band l.

    Args:
        image: float [H, W, C], linear radiance [W/m²/sr], any floating dtype. Not clamped: a sun 1e5 times
            the sky and a sky are projected to exactly the sum of their projections.
        order: 1..10.
    Returns:
        [K, C], float64 if the image is, else float32; summed in float64 by blocks of rows. Gradients reach
        `image`.
    Raises:
        InputError: image not floating [H, W, C], or holding NaN or infinite texels (with their count); order
            outside 1..10.
    """
    order = check_order(order)
    if image.dim() != 3 or not image.is_floating_point() or image.numel() == 0:
        raise InputError(f"map is {image.dtype} {list(image.shape)}: give linear radiance as floating-point [H, W, C]")
    height, width, channels = image.shape
    rows = _row_integrals(height, order).to(image.device)
    columns = _longitudes(width, order, integrate=True).to(image.device)
    place = _signed_m(order).to(image.device)
    block = max(1, BLOCK_TEXELS // width)
    total = torch.zeros(order * order, channels, dtype=torch.float64, device=image.device)
    invalid = 0
    for part, row in zip(image.split(block), rows.split(block), strict=True):
        invalid += int((~torch.isfinite(part.detach())).any(-1).sum())
        sums = torch.einsum("hwc,wm->hmc", part.double(), columns)
        total = total + torch.einsum("hk,hkc->kc", row, sums[:, place])
    if invalid:
        raise InputError(f"map has {invalid} NaN or infinite texels of {height * width}: replace them first")
    turned = _map_to_fixed(order).to(image.device) @ total
    return turned.to(torch.float64 if image.dtype == torch.float64 else torch.float32)


def render_map(coefficients: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """The band-limited function at the texel centres of an equirectangular map.

    Args:
        coefficients: float [K, C], K = order².
        height, width: size of the map, each >= 1.
    Returns:
        [H, W, C] of the dtype of `coefficients`; equal to `evaluate` at `map_directions`, and much faster.
        Gradients reach `coefficients`.
    Raises:
        InputError: coefficients not [K, C] with K = order² of an order in 1..10; height or width below 1.
    """
    _check_size(height, width)
    if coefficients.dim() != 2 or not coefficients.is_floating_point():
        raise InputError(f"coefficients are {coefficients.dtype} {list(coefficients.shape)}: give floating [K, C]")
    order, device = order_of_count(coefficients.shape[0]), coefficients.device
    polar = torch.pi / height * (torch.arange(height, dtype=torch.float64) + 0.5)
    about_pole = _map_to_fixed(order).to(device).T @ coefficients.double()
    terms = _latitudes(polar, order).to(device)[:, :, None] * about_pole
    sums = terms.new_zeros(height, 2 * order - 1, coefficients.shape[1])
    sums = sums.index_add(1, _signed_m(order).to(device), terms)
    columns = _longitudes(width, order, integrate=False).to(coefficients)
    return torch.einsum("wm,hmc->hwc", columns, sums.to(coefficients.dtype))
