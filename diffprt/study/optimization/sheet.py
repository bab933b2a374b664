"""One held-out picture of several assets beside its reference, with their differences enlarged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from diffprt.optimization import Reference
from diffprt.rendering import FrozenView, auto_exposure, picture
from diffprt.rendering.sheet import contact_sheet
from diffprt.shading import tone_map

# Small pictures are enlarged, so that their names are legible.
_LEAST_SIDE = 320
_REC709 = (0.2126, 0.7152, 0.0722)


def optimization_sheet(
    path: str | Path, assets: Mapping[str, object], names: Sequence[str], entry: Reference, view: FrozenView
) -> None:
    """Writes a PNG of two rows: pictures and, below each, their difference of luminance from the reference.

    Differences of pictures that follow each other in pairs (before, after) are shown at one scale: white is none, red
    too bright, blue too dark, full color the 99th percentile of the first one's.

    Args:
        assets: by name.
        names: an even number of them, before and after in turn.
        entry: the reference.
        view: of its camera.
    """
    reference, mask = entry.image, view.coverage == 1
    exposure = auto_exposure(reference, mask)
    weight = torch.tensor(_REC709)
    images, differences, titles = [tone_map(reference, exposure=exposure)], [torch.ones_like(reference)], ["reference"]
    limit = 0.0
    for index, name in enumerate(names):
        image = picture(assets[name], entry.light, view).detach().float()
        signed = ((image - reference) @ weight) * mask
        if index % 2 == 0:
            limit = max(float(signed[mask].abs().quantile(0.99)), 1e-12)
        share = 100 * limit / float((reference @ weight)[mask].mean())
        images.append(tone_map(image, exposure=exposure))
        differences.append(_signed_colors(signed / limit))
        titles.append(f"{name} (±{share:.2g} %)")
    factor = -(-_LEAST_SIDE // reference.shape[1])
    shown = [[x.repeat_interleave(factor, 0).repeat_interleave(factor, 1) for x in r] for r in (images, differences)]
    contact_sheet(path, shown, titles, ["picture", "difference"])


def _signed_colors(values: torch.Tensor) -> torch.Tensor:
    """White at 0, red at 1, blue at -1, [H, W, 3]."""
    positive, negative = values.clamp(0, 1), (-values).clamp(0, 1)
    return torch.stack([1 - negative, 1 - positive - negative, 1 - positive], dim=-1).clamp(0, 1)
