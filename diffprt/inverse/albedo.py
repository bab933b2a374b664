"""Inverse albedo: the reflectance of every receiver from pictures under known light, by sparse least squares.

A pixel is the interpolated product of albedo and irradiance, so that for fixed transfer it is linear in the albedo:
y = P diag(E / pi) a. Neighbors are expected to differ little, which fills in what no picture shows well. Surfaces also
light each other, T = T0 + G (albedo * T), so that transfer depends on what is looked for: with the operator G at hand
(`trace`), transfer and albedo are found in turns until they agree. Each turn shrinks the error by about the share of
light that comes from other surfaces.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.compression import ClusteredTransfer
from diffprt.errors import InputError
from diffprt.inverse.observations import Observation, Picture, observe
from diffprt.inverse.surface_fit import SurfaceFit
from diffprt.options.numbers import check_numbers
from diffprt.shading import shade
from diffprt.transfer import Transfer, Transport

_TURNS = 8
_SETTLED = 1e-3
# Noise to begin with where it is not known, and the least to find.
FIRST_NOISE, LEAST_NOISE = 0.01, 1e-3


@dataclass(frozen=True)
class AlbedoEstimate:
    """An albedo and how well the pictures tell it.

    Attributes:
        albedo: float32 [V, 3], in [0, 1].
        told: float32 [V, 3] in [0, 1], how much of each value comes from pixels; the rest comes from neighbors.
        residual: root mean square of what the albedo does not explain, as a share of the pictures'.
        clamped: share of the values told by pixels that lay outside [0, 1].
        turns: how often transfer was found again.
    """

    albedo: torch.Tensor
    told: torch.Tensor
    residual: float
    clamped: float
    turns: int

    def as_dict(self) -> dict:
        """Plain values for reports."""
        return {
            "mean": self.albedo.mean(0).tolist(),
            "told": float(self.told.mean()),
            "residual": self.residual,
            "clamped": self.clamped,
            "turns": self.turns,
        }


def recover_albedo(
    asset: Transfer | ClusteredTransfer | Transport,
    references: Iterable[Picture],
    *,
    groups: torch.Tensor | None = None,
    variation: float = 0.05,
    noise: float | None = None,
    threads: int | None = None,
) -> AlbedoEstimate:
    """The albedo of every receiver, or of every group of receivers.

    Args:
        asset: what the pictures show. Transfer is taken as it is, with the interreflection of the albedo that it was
            baked with; of a `Transport`, from `trace`, it follows the albedo.
        references: `References`, or (image, camera, light) for each.
        groups: int64 [V], receivers of one number share one albedo (materials, parts); without it each has its own.
        variation: standard deviation expected between the albedos of neighbors; smaller is smoother.
        noise: standard deviation of a pixel as a share of the pictures' root mean square; without it, the residual's.
        threads: CPU threads of rasterization.

    Raises:
        InputError: no usable picture (see `observe`), a light of another order, glossy transfer, an option out of
            range.
    """
    check_albedo_options(asset, groups, variation, noise)
    observations = observe(asset.elements, references, lit=True, threads=threads)
    lights = [o.light for o in observations if o.light is not None]
    follows = isinstance(asset, Transport)
    albedo, level = asset.elements.albedo.detach(), FIRST_NOISE if noise is None else noise
    for turn in range(1, (_TURNS if follows else 2) + 1):
        transfer = asset.transfer(albedo=albedo) if follows else asset
        turns = turn if follows else 0
        found = albedo_from(
            transfer, observations, lights, groups=groups, variation=variation, noise=level, turns=turns
        )
        change = float((found.albedo - albedo).norm() / found.albedo.norm().clamp_min(1e-12))
        albedo = found.albedo
        if change < _SETTLED or (not follows and noise is not None):
            break
        level = max(found.residual, LEAST_NOISE) if noise is None else noise
    return found


def albedo_from(
    transfer: Transfer | ClusteredTransfer,
    observations: list[Observation],
    lights: list[torch.Tensor],
    *,
    groups: torch.Tensor | None = None,
    variation: float,
    noise: float,
    turns: int = 0,
) -> AlbedoEstimate:
    """`recover_albedo` for fixed transfer, from what `observe` made and the light of each."""
    power = sum(o.power for o in observations)
    fit = SurfaceFit.of(transfer.elements, observations, groups=groups, variation=variation, noise=noise)
    columns, told, residual = [], [], 0.0
    for channel in range(3):
        sent = [_unit_radiance(transfer, o, light, channel) for o, light in zip(observations, lights, strict=True)]
        target = [o.radiance[:, channel].numpy() for o in observations]
        values, share, missed = fit.solve(sent, target)
        columns.append(values)
        told.append(share)
        residual += missed
    albedo = torch.from_numpy(np.stack(columns, axis=1))
    told = torch.from_numpy(np.stack(told, axis=1)).float()
    outside = ((albedo < 0) | (albedo > 1)) & (told > 0.5)
    return AlbedoEstimate(
        albedo.clamp(0, 1).float(),
        told,
        (residual / power) ** 0.5,
        float(outside.sum()) / max(int((told > 0.5).sum()), 1),
        turns,
    )


def _unit_radiance(transfer, observation: Observation, light: torch.Tensor, channel: int) -> np.ndarray:
    """E / pi of the receivers in sight in one color, float64 [S]: what they send for an albedo of 1."""
    seen = observation.frozen.seen
    with torch.no_grad():
        radiance = shade(transfer.picked(seen), light, albedo=torch.ones(len(seen), 3))
    return radiance[:, channel].double().numpy()


def check_albedo_options(asset, groups: torch.Tensor | None, variation: float, noise: float | None) -> None:
    asset.check_albedo()
    check_numbers({"variation": variation, "noise": noise})
    if groups is not None and tuple(groups.shape) != (len(asset.elements),):
        raise InputError(
            f"groups have shape {list(groups.shape)}: give one number per receiver, [{len(asset.elements)}]"
        )
