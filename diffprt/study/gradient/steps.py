"""One step of gradient descent through a picture, with respect to each thing that a picture depends on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch

from diffprt import sh
from diffprt.compression import ClusteredTransfer
from diffprt.rendering import FrozenView, pixel_radiance
from diffprt.scene import Light
from diffprt.transfer import Transfer

Step = Callable[[], tuple[torch.Tensor, ...]]

# Every step is computed and applied whole, but so small that the hundredth sees what the first saw.
_RATE = 1e-9


def gradient_steps(
    transfer: Transfer,
    clustered: ClusteredTransfer,
    frozen: FrozenView,
    light: Light,
    reference: torch.Tensor,
    *,
    rows: int,
) -> dict[str, Step]:
    """Steps on ‖picture - reference‖² / ‖reference‖², by the name of what they change.

    Args:
        transfer, clustered: of the same receivers.
        light: where its steps begin, and what lights the others.
        reference: [N, 3], pixels of the mask of `frozen`.
        rows: rows of the environment map; it is twice as wide.

    Returns:
        Calls that make a step and return its gradients.
    """
    start, order = light.coefficients, transfer.order

    def with_parts(**parts: torch.Tensor) -> torch.Tensor:
        return pixel_radiance(replace(clustered, **parts), start, frozen)

    def stepping(draw: Callable[..., torch.Tensor], *parameters: torch.Tensor) -> Step:
        scale = 1 / float(reference.square().sum())
        kept = list(parameters)

        def step() -> tuple[torch.Tensor, ...]:
            moving = [value.detach().requires_grad_() for value in kept]
            loss = (draw(*moving) - reference).square().sum() * scale
            gradients = torch.autograd.grad(loss, moving)
            kept[:] = [torch.sub(value.detach(), g, alpha=_RATE) for value, g in zip(moving, gradients, strict=True)]
            return gradients

        return step

    texels = sh.render_map(start, rows, 2 * rows)
    albedo = transfer.receivers.albedo
    return {
        "light": stepping(lambda light: pixel_radiance(transfer, light, frozen), start),
        "texels": stepping(lambda map: pixel_radiance(transfer, sh.project_map(map, order), frozen), texels),
        "albedo": stepping(lambda albedo: pixel_radiance(transfer, start, frozen, albedo=albedo), albedo),
        "transfer": stepping(
            lambda signal: pixel_radiance(replace(transfer, diffuse=signal), start, frozen), transfer.diffuse
        ),
        "weights": stepping(lambda weights: with_parts(weights=weights), clustered.weights),
        "bases": stepping(lambda bases: with_parts(bases=bases), clustered.bases),
        "means, bases and weights": stepping(
            lambda means, bases, weights: with_parts(means=means, bases=bases, weights=weights),
            clustered.means,
            clustered.bases,
            clustered.weights,
        ),
    }
