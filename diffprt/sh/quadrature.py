"""Quadrature on the sphere, and projection of functions and samples.

Source: product Gauss rule, e.g. Atkinson and Han, "Spherical Harmonics and Approximations on the Unit Sphere"
(2012), section 5.1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.sh.basis import basis, check_order

MAXIMUM_CONDITION = 1e10


def sphere_quadrature(degree: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Directions and weights that integrate polynomials up to `degree` over the sphere exactly.

    Gauss-Legendre in z times equal steps about +z: (degree + 1) * ceil((degree + 1) / 2) directions. No
    direction lies on a pole.

    Args:
        degree: >= 0. The product of two functions of order n has degree 2 (n - 1).
    Returns:
        directions [Q, 3] and weights [Q] (positive, sum 4π), float64.
    Raises:
        InputError: negative degree.
    """
    if degree < 0:
        raise InputError(f"quadrature degree {degree} is negative: give 0 or more")
    columns = degree + 1
    z, weights = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(degree // 2 + 1))
    angles = torch.arange(columns, dtype=torch.float64) * (2 * torch.pi / columns)
    radius = ((1 - z) * (1 + z)).sqrt()
    directions = torch.stack(
        [
            radius[:, None] * angles.cos(),
            radius[:, None] * angles.sin(),
            z[:, None].expand(-1, columns),
        ],
        dim=-1,
    )
    return directions.reshape(-1, 3), (weights * (2 * torch.pi / columns)).repeat_interleave(columns)


def project_function(
    function: Callable[[torch.Tensor], torch.Tensor], order: int, *, degree: int | None = None
) -> torch.Tensor:
    """Project a function of direction by quadrature.

    Args:
        function: takes unit directions float64 [Q, 3], returns values [Q] or [Q, C].
        order: 1..10.
        degree: polynomial degree integrated exactly, function times basis; default 64 + 2 order. A function
            with an edge (a disc, a half space) converges only like 1/degree: prefer closed forms (`cap`,
            `clamped_cosine`, `project_polygon`) or `project_map`.
    Returns:
        [K] or [K, C] in the dtype of the values. Gradients reach whatever `function` depends on.
    Raises:
        InputError: order outside 1..10, negative degree, or values not [Q] or [Q, C].
    """
    order = check_order(order)
    directions, weights = sphere_quadrature(64 + 2 * order if degree is None else degree)
    values = function(directions)
    if values.dim() not in (1, 2) or values.shape[0] != directions.shape[0]:
        raise InputError(f"function gave {list(values.shape)} for {len(directions)} directions: return [Q] or [Q, C]")
    weighted = (basis(directions, order) * weights[:, None]).to(values)
    return weighted.T @ values


def fit_samples(directions: torch.Tensor, values: torch.Tensor, order: int, *, ridge: float = 0.0) -> torch.Tensor:
    """Coefficients that fit scattered samples: least squares of (4π/D) Σ |Σ_k c_k y_k(d_i) - v_i|² + ridge
    |c|².

    Args:
        directions: float [D, 3], unit length.
        values: float [D] or [D, C].
        order: 1..10.
        ridge: >= 0, dimensionless: samples spread evenly have a Gram matrix near the identity, so 1e-3 damps
            well-determined coefficients by 0.1 %.
    Returns:
        [K] or [K, C] in the dtype of `values`; solved in float64. Gradients reach `values`, not `directions`.
    Raises:
        InputError: shapes that do not agree, non-finite samples, negative ridge, or samples that leave the
            coefficients undetermined (fewer than K, or condition number of the Gram matrix above 1e10).
    """
    count = check_order(order) ** 2
    if directions.dim() != 2 or values.dim() not in (1, 2) or values.shape[0] != directions.shape[0]:
        raise InputError(
            f"directions are {list(directions.shape)}, values {list(values.shape)}: give [D, 3] and [D, C]"
        )
    if not (torch.isfinite(directions).all() and torch.isfinite(values).all()):
        raise InputError("samples hold NaN or infinite numbers: remove them before fitting")
    if not ridge >= 0:
        raise InputError(f"ridge {ridge} is negative: give 0 or more")
    samples = directions.shape[0]
    remedy = "give more directions, lower the order, or set ridge (1e-3 is mild)"
    if samples < count and ridge == 0:
        raise InputError(f"{samples} samples leave {count} SH coefficients undetermined: {remedy}")
    scale = (4 * torch.pi / max(samples, 1)) ** 0.5
    design = basis(directions.detach().double(), order) * scale
    # QR of the design, not Cholesky of its Gram matrix: the condition number is not squared.
    damped = torch.cat([design, ridge**0.5 * torch.eye(count, dtype=design.dtype, device=design.device)])
    singular = torch.linalg.svdvals(damped)
    condition = float((singular[0] / singular[-1].clamp_min(torch.finfo(design.dtype).tiny)) ** 2)
    if not condition < MAXIMUM_CONDITION:
        raise InputError(
            f"samples leave the SH coefficients undetermined (condition number {condition:.1e}, want below "
            f"{MAXIMUM_CONDITION:.0e}): {remedy}"
        )
    orthogonal, triangular = torch.linalg.qr(damped)
    target = orthogonal[:samples].T @ (values.double() * scale).reshape(samples, -1)
    solution = torch.linalg.solve_triangular(triangular, target, upper=True)
    return solution.reshape(count, *values.shape[1:]).to(values.dtype)
