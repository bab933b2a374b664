"""Light and albedo from the same pictures, neither being known.

Twice the light on half the albedo is the same picture: the scale is fixed, in each color, by the mean albedo that is
given, of the whole object or of a patch whose reflectance is known. The shape of the light is told from the albedo
either by two or more lights, unknown but different, or by parts of the object that share an albedo: one light and an
albedo of its own for every receiver explain any picture by any light. A closed form finds the lights (`factor`);
least squares on the pixels finds the albedo, interreflection follows from it, and so on until they agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.inverse.albedo import FIRST_NOISE, LEAST_NOISE, AlbedoEstimate, albedo_from, check_albedo_options
from diffprt.inverse.factor import factored_lights
from diffprt.inverse.light import LightEstimate, distant_order, light_from
from diffprt.inverse.observations import Observation, Picture, observe
from diffprt.inverse.surface_fit import SurfaceFit
from diffprt.transfer import Transfer, Transport

_TURNS = 30
_SETTLED = 1e-4
# The next best explanation must miss the pixels by this much more than the best one.
_LEAST_MARGIN = 1.5
# What neighbors send is expected to differ by this share of the mean.
_UNLIKE = 0.05


@dataclass(frozen=True)
class JointEstimate:
    """Lights and albedo.

    Attributes:
        lights: one for each light that the pictures were taken under.
        albedo: of the receivers.
        mismatch: how far light and albedo are off what the receivers send, as a share of it.
        next_best: the same of the next best explanation; near `mismatch`, light and albedo are hardly told apart.
    """

    lights: tuple[LightEstimate, ...]
    albedo: AlbedoEstimate
    mismatch: float
    next_best: float

    def as_dict(self) -> dict:
        """Plain values for reports."""
        return {
            "lights": [light.as_dict() for light in self.lights],
            "albedo": self.albedo.as_dict(),
            "mismatch": self.mismatch,
            "next_best": self.next_best,
        }


def recover_light_and_albedo(
    asset: Transfer | Transport,
    references: Iterable[Picture],
    *,
    lit_by: Sequence[int] | None = None,
    groups: torch.Tensor | None = None,
    mean_albedo: float | torch.Tensor = 0.5,
    patch: torch.Tensor | None = None,
    order: int | None = None,
    variation: float = 0.05,
    noise: float | None = None,
    threads: int | None = None,
) -> JointEstimate:
    """Lights and albedo that the pictures were taken with.

    Args:
        asset: what they show; of a `Transport` transfer follows the albedo, as in `recover_albedo`.
        references: `References`, or (image, camera) for each; lights that they name play no part.
        lit_by: which light each picture was taken under, by number; all under one without it.
        groups: int64 [V], receivers of one number share one albedo; needed under a single light.
        mean_albedo: a number or [3]: the mean over `patch`, which fixes the scale of light and albedo.
        patch: int64 [N], the receivers that `mean_albedo` is of; without it, all that the pictures show.
        order: SH bands of the lights, at most the asset's; all of them without it.
        variation, noise, threads: as in `recover_albedo`.

    Raises:
        InputError: as `recover_albedo`; one light without groups; pictures that do not tell light from albedo.
    """
    check_albedo_options(asset, groups, variation, noise)
    observations = observe(asset.elements, references, threads=threads)
    lit_by = [0] * len(observations) if lit_by is None else list(lit_by)
    if len(lit_by) != len(observations):
        raise InputError(f"lit_by has {len(lit_by)} entries for {len(observations)} pictures: give one for each")
    names = sorted(set(lit_by))
    if len(names) == 1 and groups is None:
        raise InputError(
            "one light and an albedo for every receiver explain any picture: give pictures under two or more lights "
            "(lit_by), or groups of receivers that share an albedo"
        )
    anchor = torch.as_tensor(mean_albedo, dtype=torch.float32).expand(3)
    if not bool(((anchor > 0) & (anchor <= 1)).all()):
        raise InputError(f"mean_albedo is {anchor.tolist()}: give values above 0, at most 1")
    count = len(asset.elements)
    sets = [[o for o, name in zip(observations, lit_by, strict=True) if name == wanted] for wanted in names]
    transfer = _transfer(asset, anchor.expand(count, 3))
    known_order = distant_order(transfer)
    order = known_order if order is None else order
    known = groups if groups is not None else torch.arange(count)
    sent = [_sent(transfer, own, noise or FIRST_NOISE) for own in sets]
    rows = patch if patch is not None else (torch.stack([told for _, told in sent]).sum(0) > 0).nonzero()[:, 0]
    albedo = anchor.expand(count, 3)
    for turns in range(1, _TURNS + 1):  # noqa: B007
        lights, relative, mismatch, next_best = _factored(transfer, sent, known, order)
        scale = anchor / relative[rows].mean(0).clamp_min(1e-12)
        previous, albedo = albedo, (relative * scale).clamp(0, 1)
        transfer = _transfer(asset, albedo)
        if float((albedo - previous).norm() / albedo.norm()) < _SETTLED:
            break
    _check_told(mismatch, next_best)
    lit = [lights[names.index(name)] / scale for name in lit_by]
    options = {"groups": groups, "variation": variation, "turns": turns}
    found = albedo_from(transfer, observations, lit, noise=noise or FIRST_NOISE, **options)
    if noise is None:
        found = albedo_from(transfer, observations, lit, noise=max(found.residual, LEAST_NOISE), **options)
    found = replace(found, albedo=(found.albedo * (anchor / found.albedo[rows].mean(0).clamp_min(1e-12))).clamp(0, 1))
    transfer = _transfer(asset, found.albedo)
    estimates = [light_from(transfer, own, order=order, albedo=found.albedo) for own in sets]
    return JointEstimate(tuple(estimates), found, mismatch, next_best)


def _transfer(asset: Transfer | Transport, albedo: torch.Tensor) -> Transfer:
    return asset.transfer(albedo=albedo) if isinstance(asset, Transport) else asset


def _sent(transfer: Transfer, observations: list[Observation], noise: float) -> tuple[torch.Tensor, torch.Tensor]:
    """What every receiver sends under one light, float64 [V, 3], and how much pixels tell of it, [V]."""
    scale = max(float(o.radiance.mean()) for o in observations)
    fit = SurfaceFit.of(transfer.elements, observations, variation=_UNLIKE * scale, noise=noise)
    ones = [np.ones(len(o.frozen.seen)) for o in observations]
    found = [fit.solve(ones, [o.radiance[:, c].numpy() for o in observations]) for c in range(3)]
    told = sum(
        np.bincount(s, w.sum(axis=0), len(transfer.elements)) for s, w in zip(fit.seen, fit.contributions, strict=True)
    )
    return torch.from_numpy(np.stack([values for values, _, _ in found], axis=1)), torch.from_numpy(told)


def _factored(
    transfer: Transfer, sent: list, groups: torch.Tensor, order: int
) -> tuple[list[torch.Tensor], torch.Tensor, float, float]:
    """Lights [K, 3] and albedo [V, 3] of mean 1 by the closed form, how far it and the next best are off."""
    radiance, weights = torch.stack([values for values, _ in sent]), torch.stack([told for _, told in sent])
    lights = torch.zeros(len(sent), transfer.order**2, 3)
    albedo, misses = [], []
    for channel in range(3):
        signal = transfer.diffuse[:, channel % transfer.channels, : order**2].detach().double()
        found, relative, *miss = factored_lights(signal, radiance[..., channel], weights, groups)
        lights[:, : order**2, channel] = found.float()
        albedo.append(relative.float())
        misses.append(miss)
    return list(lights), torch.stack(albedo, dim=1), *max(misses, key=lambda miss: miss[0] / max(miss[1], 1e-300))


def _check_told(mismatch: float, next_best: float) -> None:
    if not next_best > _LEAST_MARGIN * mismatch:
        raise InputError(
            f"the pictures do not tell light from albedo: the best explanation is {100 * mismatch:.2g} % off, another "
            f"{100 * next_best:.2g} %; give pictures under more lights, or groups of receivers that share an albedo"
        )
