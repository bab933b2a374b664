"""Inverse lighting: the distant light under which pictures were taken, by linear least squares.

Radiance is linear in the light's coefficients: y = A L with one column of pixels for each coefficient. How well L is
known follows from A alone. A matt convex object answers to bands 3, 5, 7, ... with nothing, whatever shines in them
(Ramamoorthi and Hanrahan, "On the relationship between radiance and irradiance", JOSA A 2001): such bands are found by
the singular values of A, reported, and left at 0 or at what a prior says.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.compression.prior import check_prior
from diffprt.errors import InputError
from diffprt.inverse.observations import Observation, Picture, observe
from diffprt.rendering import pixel_radiance
from diffprt.representation import Representation
from diffprt.scene import Light

# Bands that move pixels by less than this share of what the strongest combination of coefficients does are lost in the
# rounding of float32 and in the interpolation between receivers.
_LEAST_GAIN = 1e-3
# The noise of sampled transfer looks like a faint answer to every coefficient. Squares of answer and noise add, so that
# what is above this many times the noise is more than half answer.
_NOISE_MARGIN = 2**0.5
_RIDGE = 1e-13
# A band is resolved when a tenth of the light could not hide in it (one standard error).
_MOST_HIDDEN = 0.1
# Cells a side of the object's box within which errors are taken to go together.
_CELLS = 12


@dataclass(frozen=True)
class LightEstimate:
    """A light and how well the pictures tell it.

    Attributes:
        light: of the order asked for; bands that cannot be seen are 0 without a prior.
        gain: of each band, the least that a unit of light in it moves the pixels (root mean square) once all other
            bands did what they can to hide it, over the most that any unit of light moves them; of the worst color.
        standard_error: of each band's coefficients, root of the sum of squares, as a share of the whole light's;
            infinite where nothing is seen of the band. Found from the residuals, so that it counts what transfer gets
            wrong as well as noise.
        observable: whether the pictures tell the band at all.
        condition: largest over least singular value of A for the bands that are observable.
        residual: root mean square of what the light does not explain, as a share of the pictures'.
    """

    light: Light
    gain: tuple[float, ...]
    standard_error: tuple[float, ...]
    observable: tuple[bool, ...]
    condition: float
    residual: float

    def as_dict(self) -> dict:
        """Plain values for reports."""
        return {
            "coefficients": self.light.coefficients.tolist(),
            "gain": list(self.gain),
            "standard_error": list(self.standard_error),
            "observable": list(self.observable),
            "condition": self.condition,
            "residual": self.residual,
        }


def recover_light(
    asset: Representation,
    references: Iterable[Picture],
    *,
    order: int | None = None,
    prior: torch.Tensor | None = None,
    noise: float | None = None,
    threads: int | None = None,
) -> LightEstimate:
    """The light that all `references` were taken under.

    Args:
        asset: what they show, with its materials; any kind of transfer.
        references: `References`, or (image, camera) for each; lights that they name play no part.
        order: SH bands to find, at most the asset's; all of them without it.
        prior: [order²], mean square of each coefficient, such as `light_prior` finds; its scale plays no part.
            Coefficients that the pictures hardly tell go towards 0 by it.
        noise: with a prior, standard deviation of a pixel as a share of the pictures' root mean square; without it, the
            residual's.
        threads: CPU threads of rasterization.

    Raises:
        InputError: no usable picture (see `observe`), or an order that the asset does not have.
    """
    known = distant_order(asset)
    order = known if order is None else order
    if not 1 <= order <= known:
        raise InputError(f"order is {order}: the asset tells 1 to {known} bands, bake with order={order} for more")
    observations = observe(asset.elements, references, threads=threads)
    return light_from(asset, observations, order=order, prior=prior, noise=noise)


def distant_order(asset: Representation) -> int:
    """The bands of distant light that the asset takes; raises InputError where it takes none."""
    if asset.order is None:
        raise InputError("the asset holds its light inside, so pictures tell nothing of one: give transfer")
    return asset.order


def light_from(
    asset: Representation,
    observations: list[Observation],
    *,
    order: int,
    prior: torch.Tensor | None = None,
    noise: float | None = None,
    albedo: torch.Tensor | None = None,
) -> LightEstimate:
    """`recover_light` from what `observe` made, with another `albedo` [V, 3] where it is given."""
    count, power = order * order, sum(o.power for o in observations)
    values = 3 * sum(len(o.radiance) for o in observations)
    designs = [design_matrix(asset, o, order, albedo=albedo) for o in observations]
    normal = right = torch.zeros(())
    for a, o in zip(designs, observations, strict=True):
        normal = normal + torch.einsum("nkc,njc->ckj", a, a)
        right = right + torch.einsum("nkc,nc->ck", a, o.radiance)
    scale = torch.linalg.eigvalsh(normal)[:, -1]
    if not bool((scale > 0).all()):
        raise InputError(
            "the asset sends nothing in some color under any light: its albedo or its transfer is 0 where it is seen"
        )
    gain = _gains(normal, order, scale)
    floor = max(_LEAST_GAIN, _NOISE_MARGIN * float(asset.certificate.get("noise_relative", 0.0)) / order)
    seen = _of_bands([value > floor for value in gain], order)
    solution, inverse = _solved(normal, right, seen)
    residuals = [
        o.radiance - torch.einsum("nkc,ck->nc", a, solution) for a, o in zip(designs, observations, strict=True)
    ]
    unexplained = sum(float(r.square().sum()) for r in residuals) / power
    error = _band_errors(designs, residuals, observations, inverse, order) / float(solution.norm().clamp_min(1e-300))
    observable = _of_bands((error < _MOST_HIDDEN).tolist(), order) & seen
    if prior is not None:
        # Of the prior's scale, the one by which pictures as bright as these are to be expected.
        mean_square = check_prior(prior, count)
        mean_square = mean_square * power / float((normal.diagonal(dim1=1, dim2=2) @ mean_square).sum())
        variance = power / values * (max(unexplained, 1e-12) if noise is None else noise**2)
        solution, _ = _solved(normal + torch.diag(variance / mean_square), right, torch.ones_like(seen))
    elif bool(observable.any()):
        solution, _ = _solved(normal, right, observable)
    else:
        raise InputError("the pictures do not tell any band of the light: give more of them, or a prior")
    told = observable.nonzero()[:, 0]
    singular = torch.linalg.eigvalsh(normal[:, told[:, None], told])
    condition = float((singular[:, -1] / singular[:, 0]).max().sqrt()) if len(told) else float("inf")
    band = sh.band_of_index(order)
    return LightEstimate(
        Light(solution.T.float().contiguous()),
        tuple(gain),
        tuple(float(e) if bool(seen[band == l].all()) else float("inf") for l, e in enumerate(error)),
        tuple(bool(observable[band == l].all()) for l in range(order)),
        condition,
        unexplained**0.5,
    )


def design_matrix(
    asset: Representation,
    observation: Observation,
    order: int,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """A of one picture, float64 [M, K, 3]: its pixels under a unit of each coefficient, in all three colors."""
    columns = []
    with torch.no_grad():
        for k in range(order * order):
            unit = torch.zeros((asset.order or order) ** 2, 3)
            unit[k] = 1.0
            columns.append(pixel_radiance(asset, unit, observation.frozen, albedo=albedo)[observation.rows].double())
    return torch.stack(columns, dim=1)


def _gains(normal: torch.Tensor, order: int, scale: torch.Tensor) -> list[float]:
    """Least singular value of each band's columns of A beside all other columns, over the largest of A."""
    band, found = sh.band_of_index(order), []
    for l in range(order):
        own, rest = band == l, band != l
        least = []
        for matrix in normal / scale[:, None, None] + _RIDGE * torch.eye(len(band), dtype=torch.float64):
            hiding = torch.linalg.solve(matrix[rest][:, rest], matrix[rest][:, own])
            schur = matrix[own][:, own] - matrix[own][:, rest] @ hiding
            least.append(float(torch.linalg.eigvalsh(schur)[0].clamp_min(0)))
        found.append(min(least) ** 0.5)
    return found


def _solved(normal: torch.Tensor, right: torch.Tensor, kept: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Coefficients [3, K] where `kept`, 0 elsewhere, and the inverse of `normal` [3, K, K] likewise."""
    inverse = torch.zeros_like(normal)
    index = kept.nonzero()[:, 0]
    inverse[:, index[:, None], index] = torch.linalg.inv(normal[:, index[:, None], index])
    return (inverse @ right[..., None])[..., 0], inverse


def _of_bands(bands: list[bool], order: int) -> torch.Tensor:
    """A value per band as one per coefficient, bool [K]."""
    return torch.tensor(bands)[sh.band_of_index(order)]


def _band_errors(designs, residuals, observations: list[Observation], inverse: torch.Tensor, order: int):
    """Standard error of each band's coefficients, root of the sum of squares, [order].

    What transfer gets wrong is wrong alike in all pixels near by. So residuals are taken to be independent from one
    cell of space to the next only (cluster-robust covariance: Liang and Zeger, "Longitudinal data analysis using
    generalized linear models", Biometrika 1986).
    """
    positions = observations[0].frozen.elements.positions
    low, size = positions.amin(0), float((positions.amax(0) - positions.amin(0)).max()) or 1.0
    cells, scores = [], []
    for design, residual, observation in zip(designs, residuals, observations, strict=True):
        frozen = observation.frozen
        points = frozen.pixels(positions[frozen.seen])[observation.rows]
        cell = ((points - low) / size * _CELLS).long().clamp(0, _CELLS - 1)
        cells.append((cell * torch.tensor([1, _CELLS, _CELLS**2])).sum(1))
        scores.append(torch.einsum("nkc,nc->nck", design, residual))
    kinds, cell = torch.cat(cells).unique(return_inverse=True)
    total = torch.zeros(len(kinds), *scores[0].shape[1:], dtype=torch.float64).index_add_(0, cell, torch.cat(scores))
    coefficients = torch.einsum("ckj,gcj->gck", inverse, total)
    square = coefficients.square().sum((0, 1)) * len(kinds) / max(len(kinds) - 1, 1)
    return torch.zeros(order, dtype=torch.float64).index_add_(0, sh.band_of_index(order), square).sqrt()
