"""How far pictures are from their references, in linear radiance and as an eye or a display sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import kornia
import torch

from diffprt.errors import InputError
from diffprt.optimization.own_loss import OwnLoss, own_name
from diffprt.options.optimize import LABEL_LOSSES, LOSSES
from diffprt.shading import tone_map

# Side of the window over which SSIM compares local means and variances (Wang et al. 2004).
_WINDOW = 11
_LARGEST_WEIGHT = 1e6


def relative_squared(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """Squared error over the reference's energy, in linear radiance: all references weigh alike, however bright."""
    return (image - reference).square()[mask].sum() / reference.square()[mask].sum()


def log_squared(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """Mean squared difference of log(1 + exposed radiance): a sun and a shadow count alike."""
    one, other = ((exposure * x[mask]).clamp_min(0).log1p() for x in (image, reference))
    return (one - other).square().mean()


def display_squared(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """Mean squared difference after tone mapping (ACES): what a display shows."""
    return (_shown(image, exposure) - _shown(reference, exposure))[mask].square().mean()


def psnr(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """Minus the peak signal to noise ratio [dB] of tone-mapped pictures."""
    return kornia.losses.psnr_loss(_batch(image, mask, exposure), _batch(reference, mask, exposure), max_val=1.0)


def ssim(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """(1 - SSIM) / 2 of tone-mapped pictures (Wang et al. 2004)."""
    return kornia.losses.ssim_loss(_batch(image, mask, exposure), _batch(reference, mask, exposure), _WINDOW)


def total_variation(image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """Total variation of the tone-mapped difference, per pixel: seams between clusters rather than gentle shifts."""
    difference = _batch(image, mask, exposure) - _batch(reference, mask, exposure)
    return kornia.losses.total_variation(difference, reduction="mean").sum()


ImageLoss = Callable[..., torch.Tensor]
# Keys are names and functions: a mapping's keys are invariant, so that no type of both would admit either.
LossLike = str | ImageLoss | Mapping[Any, float]

IMAGE_LOSSES: dict[str, ImageLoss] = {
    "image": relative_squared,
    "log": log_squared,
    "display": display_squared,
    "psnr": psnr,
    "ssim": ssim,
    "total-variation": total_variation,
}


def named_losses(loss: LossLike) -> tuple[str | dict[str, float], dict[str, OwnLoss]]:
    """What `parse_loss` takes, with names in place of callables, and the callables by these names.

    Raises:
        InputError: neither text, a callable, nor weights of these; or a callable that takes no two pictures.
    """
    if isinstance(loss, str):
        return loss, {}
    terms: Mapping[Any, float] = loss if isinstance(loss, Mapping) else {loss: 1.0}
    weights: dict[str, float] = {}
    own: dict[str, OwnLoss] = {}
    for term, weight in terms.items():
        if isinstance(term, str):
            weights[term] = weight
            continue
        if not callable(term) or isinstance(term, type):
            raise InputError(
                f"loss is {term!r}: give names, such as 'image + 0.1*ssim', a function loss(image, reference), or "
                "weights of these"
            )
        name = own_name(term)
        name = next(n for n in (name, *(f"{name} {i}" for i in range(2, len(terms) + 2))) if n not in own)
        weights[name], own[name] = weight, OwnLoss(name, term)
    return weights, own


def parse_loss(loss: str | Mapping[str, float], own: Mapping[str, OwnLoss] | None = None) -> dict[str, float]:
    """Weights of losses by name, from such a dictionary or from "image + 0.1*ssim".

    Args:
        own: losses of the user's own, whose names are known too.

    Raises:
        InputError: a name is unknown, or a weight is not above 0.
    """
    if isinstance(loss, str):
        terms = [part.strip().rpartition("*")[::2] for part in loss.split("+")]
        loss = {}
        for weight, name in terms:
            try:
                loss[name.strip()] = float(weight or 1)
            except ValueError:
                raise InputError(f"loss weight '{weight}' is no number: write such as image + 0.1*ssim") from None
    for name, weight in loss.items():
        if name not in LOSSES and name not in (own or {}):
            raise InputError(f"loss '{name}' is unknown: use one of {', '.join(LOSSES)}, or give a function")
        if not isinstance(weight, int | float) or not 0 < weight <= _LARGEST_WEIGHT:
            raise InputError(f"loss '{name}' has weight {weight}: give a number above 0, at most {_LARGEST_WEIGHT:g}")
    if not set(loss) - {*LABEL_LOSSES}:
        raise InputError("loss has nothing that compares with references: add image or transfer")
    return dict(loss)


def _shown(image: torch.Tensor, exposure: float) -> torch.Tensor:
    return tone_map(image, exposure=exposure, curve="aces")


def _batch(image: torch.Tensor, mask: torch.Tensor, exposure: float) -> torch.Tensor:
    """[1, 3, H, W] of display values, black outside the mask."""
    return (_shown(image, exposure) * mask[..., None]).permute(2, 0, 1)[None]
