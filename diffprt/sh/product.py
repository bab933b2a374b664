"""Products of functions on the sphere: the integrals of three harmonics, and what they turn one function into.

Bands l1 and l2 multiply into bands |l1 - l2| .. l1 + l2 and no others, so the product of two functions of orders a
and b is known exactly from order a + b - 1 of any third one. The integrals are found by a product Gauss rule that
is exact for them.

Source: Gaunt, "The Triplets of Helium" (Phil. Trans. A 1929), for the integral; Sloan, Kautz and Snyder,
"Precomputed Radiance Transfer for Real-Time Rendering" (SIGGRAPH 2002), section 4, for visibility as a matrix.
"""

from __future__ import annotations

from functools import lru_cache

import torch

from diffprt.sh.basis import PRODUCT_ORDER, basis, check_order, order_of_count
from diffprt.sh.quadrature import sphere_quadrature

# Rounding leaves about 1e-15 where the selection rules say zero; the least integral of order 10 is above 1e-5.
_ZERO = 1e-12


@lru_cache(maxsize=8)
def triple_products(order_a: int, order_b: int, order_c: int) -> torch.Tensor:
    """The integrals ∫ y_i y_j y_k over the sphere.

    Args:
        order_a, order_b, order_c: of i, j and k, each an order that `basis` knows.
    Returns:
        float64 [Ka, Kb, Kc], shared between calls: do not write to it. Entries that vanish by symmetry are exact
        zeros.
    Raises:
        InputError: an order out of range.
    """
    orders = [check_order(order, most=PRODUCT_ORDER) for order in (order_a, order_b, order_c)]
    directions, weights = sphere_quadrature(sum(orders) - 3)
    a, b, c = (basis(directions, order) for order in orders)
    pairs = (a[:, :, None] * b[:, None, :] * weights[:, None, None]).flatten(1)
    integrals = (pairs.T @ c).reshape(a.shape[1], b.shape[1], c.shape[1])
    return torch.where(integrals.abs() < _ZERO, 0.0, integrals)


def product_matrix(coefficients: torch.Tensor, order_out: int, order_in: int) -> torch.Tensor:
    """The matrix that multiplies by a function: M_ij = ∫ f y_i y_j.

    M c are the coefficients, up to `order_out`, of f times the function that c describes. Bands of f from
    order_out + order_in - 1 on do not matter.

    Args:
        coefficients: float [..., K] of f.
        order_out, order_in: of i and of j.
    Returns:
        [..., K_out, K_in] in the dtype of `coefficients`. Gradients reach them.
    Raises:
        InputError: an order out of range, or K not order² of one.
    """
    order = min(order_of_count(coefficients.shape[-1], most=PRODUCT_ORDER), order_out + order_in - 1)
    tensor = triple_products(order_out, order_in, order).to(coefficients)
    flat = coefficients[..., : order**2] @ tensor.flatten(0, 1).T
    return flat.unflatten(-1, tensor.shape[:2])


def multiply(a: torch.Tensor, b: torch.Tensor, order: int) -> torch.Tensor:
    """Coefficients, up to `order`, of the product of two functions.

    Args:
        a, b: float [..., Ka] and [..., Kb], leading axes that broadcast.
        order: of the result; order_a + order_b - 1 holds the whole product.
    Returns:
        [..., order²] in the dtype of `a`. Gradients reach both.
    Raises:
        InputError: an order out of range, or a count that is not order² of one.
    """
    tensor = triple_products(
        order, order_of_count(a.shape[-1], most=PRODUCT_ORDER), order_of_count(b.shape[-1], most=PRODUCT_ORDER)
    ).to(a)
    return torch.einsum("kij,...i,...j->...k", tensor, a, b.to(a))
