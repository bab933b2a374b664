"""Interreflection to convergence: (I - G A) T = T_0 by minimal residuals, with implicit gradients."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from diffprt.errors import InputError
from diffprt.surface.operator import BounceOperator

CONVERGENCE_TOLERANCE = 1e-4
_MOST_PRODUCTS = 512
# A receiver whose rays all meet white surfaces: float32 sums of up to 2^20 equal shares round to within this.
_LEAST_LEAK = 1e-6
# Directions kept between restarts, and the bytes they may take together.
_FEWEST_DIRECTIONS, _MOST_DIRECTIONS, _DIRECTION_BYTES = 4, 24, 1 << 31

LinearMap = Callable[[torch.Tensor], torch.Tensor]


@dataclass(frozen=True)
class Convergence:
    """How a solve ended.

    Attributes:
        products: products with G.
        residual: what the equation is off by, as a share of its right-hand side (root mean squares).
        error: estimate of what the solution is off by, likewise: the residual over the least singular value that
            the solve has seen.
    """

    products: int
    residual: float
    error: float

    def as_certificate(self) -> dict:
        """Plain values for the certificate of an asset."""
        return {"convergence_residual": self.residual, "convergence_error": self.error}


def converge(
    direct: torch.Tensor, operator: BounceOperator, albedo: torch.Tensor, *, tolerance: float = CONVERGENCE_TOLERANCE
) -> tuple[torch.Tensor, Convergence]:
    """Transfer after all diffuse interreflections: the solution of (I - G A) T = T_0.

    Args:
        direct: [V, C, K], transfer without interreflection, of the surfaces that reflect.
        albedo: [V, C], linear, in [0, 1].
        tolerance: error that may remain, as a share of `direct`.

    Returns:
        [V, C, K] and how the solve ended. Gradients reach `direct` and `albedo` through one solve with (I - G A)ᵀ
        (implicit differentiation): memory does not grow with the number of products. Second derivatives are not
        offered.

    Raises:
        InputError: some surfaces are white and see only each other, or the solve does not end.
    """
    with torch.no_grad():
        _check_light_can_leave(operator, albedo)
        signal, ended = minimal_residual(_reflection(operator, albedo), direct, tolerance)
    if direct.requires_grad or albedo.requires_grad:
        signal = _Implicit.apply(direct, albedo, signal, operator, tolerance)
    return signal, ended


def minimal_residual(reflect: LinearMap, right: torch.Tensor, tolerance: float) -> tuple[torch.Tensor, Convergence]:
    """Solves x - reflect(x) = right for every channel: restarted GMRES (Saad and Schultz 1986) from x = 0.

    All coefficients of a channel have one matrix, so that one Krylov space serves them together. Up to the first
    restart no combination of the products made leaves a smaller residual; the Neumann series is one of them. The
    last step, x + r, is one bounce more and costs no product, since the residual r is known.

    Args:
        reflect: linear, [V, C, K] to [V, C, K], channel by channel, of spectral radius below 1.
        right: float32 or float64 [V, C, K].
        tolerance: error that may remain, as a share of `right`.

    Raises:
        InputError: 512 products do not suffice.
    """
    size = float(_norm(right).norm())
    solution, residual, products, least = torch.zeros_like(right), right, 0, math.inf
    if size == 0:
        return solution, Convergence(0, 0.0, 0.0)
    most = _directions(right.numel() * right.element_size())
    while products < _MOST_PRODUCTS:
        start = _norm(residual)
        basis = [_scaled(residual, start)]
        hessenberg = torch.zeros(right.shape[1], most + 1, most, dtype=torch.float64)
        for j in range(most):
            new = basis[j] - reflect(basis[j])
            products += 1
            for i, old in enumerate(basis):
                hessenberg[:, i, j] = _dot(old, new)
                new = torch.addcmul(new, old, -hessenberg[:, i, j].to(new.dtype)[:, None])
            hessenberg[:, j + 1, j] = _norm(new)
            basis.append(_scaled(new, hessenberg[:, j + 1, j]))
            weights, left, smallest = _least_squares(hessenberg[:, : j + 2, : j + 1], start)
            residual_share = float(left.norm()) / size
            error_share = float((left.norm(dim=1) / smallest.clamp_max(least)).norm()) / size
            if error_share <= tolerance:
                break
        least = smallest.clamp_max(least)
        solution = _combined(solution, weights, basis)
        residual = _combined(torch.zeros_like(right), left, basis)
        if error_share <= tolerance:
            return solution + residual, Convergence(products, residual_share, error_share)
    raise InputError(
        f"interreflection does not converge: after {products} products {100 * error_share:.2g} % of the signal are "
        "still open; lower the albedo, or give a number of bounces"
    )


class _Implicit(torch.autograd.Function):
    """The solution as a function of direct transfer and albedo: dT = (I - G A)⁻¹ (dT_0 + G dA T)."""

    @staticmethod
    def forward(ctx, direct, albedo, signal, operator, tolerance) -> torch.Tensor:
        ctx.save_for_backward(albedo, signal)
        ctx.operator, ctx.tolerance = operator, tolerance
        return signal.view_as(signal)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, gradient: torch.Tensor):
        albedo, signal = ctx.saved_tensors
        turned = ctx.operator.transposed()

        def spread(received: torch.Tensor) -> torch.Tensor:
            return turned(received.reshape(len(received), -1)).reshape(signal.shape)

        adjoint, _ = minimal_residual(lambda received: albedo[:, :, None] * spread(received), gradient, ctx.tolerance)
        to_albedo = (spread(adjoint) * signal).sum(-1) if ctx.needs_input_grad[1] else None
        return adjoint, to_albedo, None, None, None


def _reflection(operator: BounceOperator, albedo: torch.Tensor) -> LinearMap:
    """One bounce, x to G (albedo * x)."""
    return lambda signal: operator.gather(albedo[:, :, None] * signal)


def direction_bytes(signal_bytes: int) -> int:
    """Bytes that a solve holds beside a signal of `signal_bytes`."""
    return (_directions(signal_bytes) + 4) * signal_bytes


def _directions(signal_bytes: int) -> int:
    """Directions between restarts."""
    return min(max(_DIRECTION_BYTES // signal_bytes, _FEWEST_DIRECTIONS), _MOST_DIRECTIONS)


def _check_light_can_leave(operator: BounceOperator, albedo: torch.Tensor) -> None:
    """Refuses white surfaces that see only each other: rows of G A that sum to 1 make I - G A singular."""
    if float(albedo.max()) <= 1 - _LEAST_LEAK:
        return
    albedo = albedo.detach().to(torch.float32)
    leaks = operator.product(albedo) < 1 - _LEAST_LEAK
    count = -1
    while not bool(leaks.all()) and int(leaks.sum()) > count:
        count = int(leaks.sum())
        leaks = leaks | (operator.product(albedo * leaks) > 0)
    trapped = int((~leaks.all(1)).sum())
    if trapped:
        raise InputError(
            f"interreflection does not converge: {trapped} of {len(leaks)} receivers have albedo 1 all around and no "
            "way out (rows of G sum to 1); give an albedo below 1, or a number of bounces"
        )


def _least_squares(hessenberg: torch.Tensor, start: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Weights [C, j] of the basis that leave the least of `start` [C] times its first vector, what they leave
    [C, j + 1], and the least singular value [C] (of channels that are not solved already)."""
    target = torch.zeros(hessenberg.shape[:2], dtype=torch.float64)
    target[:, 0] = start
    u, values, v = torch.linalg.svd(hessenberg, full_matrices=False)
    known = values > 1e-10 * values[:, :1]
    inverse = torch.where(known, 1 / values, 0.0)
    weights = torch.einsum("cji,cj,caj,ca->ci", v, inverse, u, target)
    left = target - torch.einsum("caj,cj->ca", hessenberg, weights)
    return weights, left, torch.where(known, values, torch.inf).amin(1)


def _combined(first: torch.Tensor, weights: torch.Tensor, basis: list[torch.Tensor]) -> torch.Tensor:
    """`first` plus the vectors of `basis` [V, C, K] times `weights` [C, J]."""
    for column, vector in zip(weights.to(first.dtype).T, basis, strict=False):
        first = torch.addcmul(first, vector, column[:, None])
    return first


def _dot(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Products of the channels of [V, C, K], float64 [C]. NumPy sums over V in one order for any number of threads."""
    return torch.from_numpy((a * b).sum(2, dtype=torch.float64).numpy().sum(0))


def _norm(a: torch.Tensor) -> torch.Tensor:
    """Lengths of the channels of [V, C, K], float64 [C]."""
    return _dot(a, a).sqrt()


def _scaled(a: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
    """Unit vectors; zero where the length is zero."""
    return a * torch.where(lengths > 0, 1 / lengths, 0.0).to(a.dtype)[:, None]
