"""Whether references can be of this asset at all: what would train it towards nonsense is refused by name."""

from __future__ import annotations

import math

import torch

from diffprt.errors import InputError
from diffprt.optimization.references.references import References, bounds_of
from diffprt.rendering import FrozenView

# How far boxes may differ, as a share of their diagonal.
_BOX = 1e-3
# Least intersection over union of the object and what is not black, in pictures with a black background.
_OVERLAP = 0.8
# Least share of exactly black pixels that make a background black.
_BLACK = 0.02


def check_references(asset, references: References) -> list[FrozenView]:
    """The frozen view of every reference, cameras shared.

    Raises:
        InputError: references of another scene or light order, pixels that are not finite, black pictures, a camera
            that sees nothing of the asset, or an object of another outline.
    """
    if asset.order is None:
        asset.refuse("answers to no distant light, which references are made under", "optimize one that does")
    if references.order != asset.order:
        raise InputError(
            f"references have lights of order {references.order}, the asset has order {asset.order}: make references "
            f"with lights of order {asset.order}"
        )
    if references.scene_hash and asset.scene_hash and references.scene_hash != asset.scene_hash:
        raise InputError(
            f"references are of scene {references.scene_hash[:12]}, the asset of {asset.scene_hash[:12]}: give "
            "references of the same scene"
        )
    if references.bounds:
        _check_bounds(bounds_of(asset.elements), references.bounds)
    views: dict = {}
    for index, entry in enumerate(references):
        if entry.camera not in views:
            views[entry.camera] = FrozenView.of(asset.elements, entry.camera, samples=references.samples)
        view = views[entry.camera]
        if not bool((view.coverage == 1).any()):
            raise InputError(f"no pixel of reference picture {index} lies inside the asset: move the camera nearer")
        _check_picture(index, entry.image, view.mask)
    return [views[entry.camera] for entry in references]


def _check_bounds(own: tuple, theirs: tuple) -> None:
    size = math.dist(*own) or 1.0
    if any(math.dist(a, b) > _BOX * size for a, b in zip(own, theirs, strict=True)):
        text = [" to ".join(str([round(x, 4) for x in corner]) for corner in box) for box in (theirs, own)]
        raise InputError(f"references show a box from {text[0]}, the asset's is from {text[1]}: another scene or scale")


def _check_picture(index: int, image: torch.Tensor, mask: torch.Tensor) -> None:
    finite = torch.isfinite(image).all(-1)
    if not bool(finite.all()):
        raise InputError(
            f"reference picture {index} has {int((~finite).sum())} pixels that are not finite: render it again"
        )
    lit = (image != 0).any(-1)
    if not bool(lit.any()):
        raise InputError(f"reference picture {index} is black everywhere: light the scene, or leave the picture out")
    if not bool(lit[mask].any()):
        raise InputError(
            f"reference picture {index} is black where the asset is seen, and not elsewhere: its camera is not the "
            "picture's"
        )
    if float((~lit).float().mean()) < _BLACK:
        return
    overlap = float((lit & mask).sum()) / float((lit | mask).sum())
    if overlap < _OVERLAP:
        raise InputError(
            f"reference picture {index} overlaps with the asset by {100 * overlap:.0f} %: another scene or camera"
        )
