"""A sheet of two pictures and their signed difference, pixel by pixel and averaged over neighborhoods."""

from __future__ import annotations

from pathlib import Path

import torch
from matplotlib.figure import Figure

from diffprt.rendering import auto_exposure
from diffprt.rendering.sheet import save_figure
from diffprt.shading import tone_map

_REC709 = (0.2126, 0.7152, 0.0722)
# Half a side of the squares over which the second difference is averaged [pixels].
_REACH = 4


def comparison_sheet(
    path: str | Path,
    ours: torch.Tensor,
    reference: torch.Tensor,
    mask: torch.Tensor,
    *,
    names: tuple[str, str],
    title: str,
) -> None:
    """Writes a PNG: both pictures at one exposure, and the difference of their luminance with color bars.

    The reference's noise dominates single pixels. Averaged over squares of 9 x 9 it nearly vanishes, and what
    is left is where the pictures really differ.

    Args:
        ours, reference: [H, W, 3], linear radiance.
        mask: bool [H, W]; the difference is shown inside, and relative to the reference's mean there.
        names: of the two pictures.
    """
    weight = torch.tensor(_REC709, dtype=torch.float64)
    ours, reference = ours.detach().double().cpu(), reference.detach().double().cpu()
    mean = float((reference @ weight)[mask].mean())
    signed = ((ours - reference) @ weight) / (mean or 1.0)
    exposure = auto_exposure(reference, mask)
    height, width = mask.shape
    side = 3.6
    figure = Figure(
        figsize=(4 * side + 2.0, side * height / width + 0.8), dpi=max(width / side, 100.0), layout="constrained"
    )
    figure.suptitle(title, fontsize=11)
    axes = figure.subplots(1, 4)
    for axis, image, name in zip(axes, (ours, reference), names, strict=False):
        axis.imshow(tone_map(image, exposure=exposure).numpy(), interpolation="nearest")
        axis.set_title(name, fontsize=11)
    averaged = f"averaged over {2 * _REACH + 1} x {2 * _REACH + 1} pixels"
    _difference(figure, axes[2], signed, mask, f"{names[0]} - {names[1]}")
    _difference(figure, axes[3], _local_mean(signed, mask), mask, averaged)
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_visible(False)
    save_figure(path, figure)


def _difference(figure: Figure, axis, signed: torch.Tensor, mask: torch.Tensor, name: str) -> None:
    """Shows `signed` [H, W] inside the mask; colors saturate at its 99th percentile."""
    limit = max(float(signed[mask].abs().quantile(0.99)), 1e-6)
    shown = axis.imshow(
        torch.where(mask, signed, torch.nan).numpy(), cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest"
    )
    axis.set_facecolor("0.75")
    axis.set_title(name, fontsize=11)
    bar = figure.colorbar(shown, ax=axis, shrink=0.85, extend="both")
    bar.set_label("luminance [share of the reference's mean]", fontsize=9)
    bar.formatter = lambda value, _: f"{100 * value:+.2g} %"
    bar.update_ticks()


def _local_mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean of `values` [H, W] over the pixels of the mask in the square around each pixel."""
    weights = mask.double()[None, None]
    size = 2 * _REACH + 1

    def total(image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.avg_pool2d(image, size, stride=1, padding=_REACH)

    return (total(values[None, None] * weights) / total(weights).clamp_min(1e-12))[0, 0]
