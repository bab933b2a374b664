"""How well a picture agrees with a noisy reference of which there are two independent halves."""

from __future__ import annotations

import torch


def agreement(picture: torch.Tensor, halves: tuple[torch.Tensor, torch.Tensor], mask: torch.Tensor) -> dict:
    """Root mean square differences inside `mask`, as shares of the reference's own root mean square.

    With o the picture and A, B the halves, (o - (A+B)/2)² - ((A-B)/2)² = (o - A)(o - B), whose expectation is
    the squared error of o: the noises of A and B are independent and drop out. So nothing is assumed about
    the noise, and the spread of that product over pixels tells how small an error the sample count resolves.

    Args:
        picture: [H, W, 3], linear radiance.
        halves: two [H, W, 3], independent estimates.
        mask: bool [H, W], the pixels that count; at least one.

    Returns:
        Plain numbers. `relative_rmse`: the error without the reference's noise; 0 where that is below what
        chance leaves. `noise`: the noise of the mean of the halves. `difference`: error and noise together.
        `resolution`: errors below this are not told from zero (two standard errors, pixels independent).
        `mean_ratio`: mean of the picture over mean of the reference. `pixels`: how many count.
    """
    ours, one, two = (image.detach().double()[mask] for image in (picture, *halves))
    mean = (one + two) / 2
    scale = float(mean.square().mean())
    # The three channels of a pixel share their paths, so pixels are the independent samples.
    squared = ((ours - one) * (ours - two)).mean(-1)
    spread = float(squared.std(correction=0)) / len(squared) ** 0.5

    def share(square: float) -> float:
        return (max(square, 0.0) / scale) ** 0.5 if scale > 0 else 0.0

    return {
        "relative_rmse": share(float(squared.mean())),
        "noise": share(float(((one - two) / 2).square().mean())),
        "difference": share(float((ours - mean).square().mean())),
        "resolution": share(2 * spread),
        "mean_ratio": float(ours.mean() / mean.mean()) if float(mean.mean()) else 1.0,
        "pixels": len(squared),
    }


def eroded(mask: torch.Tensor) -> torch.Tensor:
    """The pixels of `mask` [H, W] whose eight neighbours are in it too; the border of the picture is not."""
    outside = (~mask).float()[None, None]
    near = torch.nn.functional.max_pool2d(
        torch.nn.functional.pad(outside, (1, 1, 1, 1), value=1.0), kernel_size=3, stride=1
    )
    return near[0, 0] == 0
