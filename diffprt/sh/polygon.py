"""Exact projection of the indicator of a spherical polygon.

Y_lm is an eigenfunction of the sphere's Laplacian, ΔY = -l (l + 1) Y. Green's identity therefore turns its
integral over a region into one over the edges, of the derivative across the edge. On a great-circle arc the
normal is constant and the integrand a trigonometric polynomial of degree l, which Gauss-Legendre nodes
integrate to rounding: no subdivision, no tolerance. Band 0 is the solid angle.

Sources: Wang and Ramamoorthi, "Analytic Spherical Harmonic Coefficients for Polygonal Area Lights" (SIGGRAPH
2018), who reduce to the boundary too, by way of zonal lobes; Van Oosterom and Strackee (1983) for the solid
angle.
"""

from __future__ import annotations

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.sh.basis import basis, check_order

# Exact to rounding for order 10 on arcs up to π.
NODES = 32


def project_polygon(corners: torch.Tensor, order: int) -> torch.Tensor:
    """∫ y_lm over the directions in which a polygon is seen from the origin.

    Args:
        corners: float [N, 3], N >= 3, any lengths but zero: a simple polygon in a plane that misses the
            origin. Convex or not; either winding.
        order: 1..10.
    Returns:
        [K] of the dtype of `corners`; the first entry is the solid angle over √(4π), never negative.
        Gradients reach `corners`.
    Raises:
        InputError: corners not floating [N >= 3, 3], a corner at the origin, or order outside 1..10.
    """
    order = check_order(order)
    if not corners.is_floating_point() or corners.dim() != 2 or corners.shape[0] < 3 or corners.shape[1] != 3:
        raise InputError(f"corners are {corners.dtype} {list(corners.shape)}: give floating-point [N, 3], N at least 3")
    if not bool((corners.detach().abs().amax(-1) > 0).all()):
        raise InputError("a corner of the polygon lies at the origin: move the viewpoint off the polygon")
    unit = torch.nn.functional.normalize(corners, dim=-1)
    solid_angle = _signed_solid_angle(unit)
    orientation = torch.sign(solid_angle.detach())
    constant = (orientation * solid_angle)[None] * (0.25 / torch.pi) ** 0.5
    if order == 1:
        return constant

    bands = torch.cat([torch.full((2 * l + 1,), l * (l + 1.0)) for l in range(1, order)]).to(corners)
    return torch.cat([constant, orientation * _slope_across_edges(unit, order)[1:] / bands])


def _slope_across_edges(unit: torch.Tensor, order: int) -> torch.Tensor:
    """∮ ∂y/∂n ds over the arcs between unit corners [N, 3], n pointing to the left of the way: [K]."""
    start, end = unit, unit.roll(-1, 0)
    normal = torch.linalg.cross(start, end)
    long = torch.linalg.vector_norm(normal.detach(), dim=-1) > 0  # an edge seen end-on bounds nothing
    start, end, normal = start[long], end[long], normal[long]
    sine = torch.linalg.vector_norm(normal, dim=-1, keepdim=True)
    angle = torch.atan2(sine, (start * end).sum(-1, keepdim=True))
    normal = normal / sine
    nodes, weights = (torch.from_numpy(table).to(unit) for table in np.polynomial.legendre.leggauss(NODES))
    along = (angle * (nodes + 1) / 2)[..., None]
    points = start[:, None] * along.cos() + torch.linalg.cross(normal, start)[:, None] * along.sin()
    # M. Riesz (1914): the slope of a trigonometric polynomial of degree n is a fixed sum of 2n of its values.
    # Here it runs round the great circle through the point and the edge's normal.
    degree = order - 1
    turns = torch.pi * (torch.arange(2 * degree).to(unit) + 0.5) / degree
    factors = 1 / (4 * degree * (turns / 2).sin().square())
    factors[1::2] *= -1
    turns = turns[:, None]
    circle = points[:, :, None] * turns.cos() + normal[:, None, None] * turns.sin()
    return torch.einsum("eqtk,t,eq->k", basis(circle, order), factors, angle / 2 * weights)


def _signed_solid_angle(unit: torch.Tensor) -> torch.Tensor:
    """Solid angle [sr] of unit corners [N, 3], positive if they run counterclockwise seen from outside."""
    a, b, c = unit[:1], unit[1:-1], unit[2:]
    # The determinant of (a, b, c), through differences: no cancellation for small polygons.
    volume = (a * torch.linalg.cross(b - a, c - a)).sum(-1)
    denominator = 1 + (a * b).sum(-1) + (b * c).sum(-1) + (c * a).sum(-1)
    return 2 * torch.atan2(volume, denominator).sum()
