"""Pictures as measurements: which pixels count, and what the asset's receivers contribute to each of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import scipy.sparse
import torch

from diffprt.errors import InputError
from diffprt.optimization.references.references import Reference
from diffprt.rendering import FrozenView
from diffprt.representation import ConstantBasis
from diffprt.representation.elements import Elements
from diffprt.scene import Camera

# Samples a side of our pixels: edges inside the object are averaged as a camera's pixels do.
_SAMPLES = 2
_LEAST_PIXELS = 16

# A picture [H, W, 3] in linear radiance, its camera and, where it is known, its light [K, 3].
Picture = Reference | tuple[torch.Tensor, Camera] | tuple[torch.Tensor, Camera, torch.Tensor]


@dataclass(frozen=True)
class Observation:
    """One picture of the object.

    Attributes:
        frozen: the view.
        rows: int64 [M], which of its masked pixels count: those well inside the outline.
        radiance: float64 [M, 3], what the picture shows there.
        light: float [K, 3], its light; None where it is not known.
    """

    frozen: FrozenView
    rows: torch.Tensor
    radiance: torch.Tensor
    light: torch.Tensor | None

    @property
    def power(self) -> float:
        """Sum of squares of the pixels."""
        return float(self.radiance.square().sum())

    def contributions(self) -> scipy.sparse.csr_array:
        """What the receivers in sight contribute to the pixels that count, float64 [M, S]."""
        matrix = self.frozen.operator(ConstantBasis()).matrix
        parts = (matrix.values().double(), matrix.col_indices(), matrix.crow_indices())
        whole = scipy.sparse.csr_array(tuple(part.numpy() for part in parts), shape=tuple(matrix.shape))
        return whole[self.rows.numpy()]


def observe(
    receivers: Elements, pictures: Iterable[Picture], *, lit: bool = False, threads: int | None = None
) -> list[Observation]:
    """Pictures as measurements of what `receivers` send.

    Args:
        pictures: `References`, or (image, camera) or (image, camera, light) for each.
        lit: whether the lights must be known.

    Raises:
        InputError: there are none; one has another size than its camera, pixels that are not finite, sees nothing of
            the object, is black where the object is, or has no light where it is needed.
    """
    found = []
    for index, picture in enumerate(pictures):
        image, camera, light = _parts(picture)
        try:
            found.append(_observation(receivers, image, camera, light, lit, threads))
        except InputError as error:
            raise InputError(f"reference {index}: {error}") from error
    if not found:
        raise InputError("there are no references: give at least one picture with its camera")
    return found


def _parts(picture: Picture) -> tuple[torch.Tensor, Camera, torch.Tensor | None]:
    if isinstance(picture, Sequence):
        return picture[0], picture[1], picture[2] if len(picture) > 2 else None
    return picture.image, picture.camera, picture.light


def _observation(receivers, image, camera, light, lit, threads) -> Observation:
    if tuple(image.shape) != (camera.height, camera.width, 3):
        raise InputError(
            f"the picture is {list(image.shape)}, its camera {camera.width} x {camera.height}: give "
            f"[{camera.height}, {camera.width}, 3]"
        )
    bad = int((~torch.isfinite(image)).any(-1).sum())
    if bad:
        raise InputError(f"{bad} of {image.shape[0] * image.shape[1]} pixels are not finite: repair the picture")
    if lit and light is None:
        raise InputError("the light is not known: give it, or recover light and albedo together")
    frozen = FrozenView.of(receivers, camera, samples=_SAMPLES, threads=threads)
    inside = _inner(frozen.coverage)
    if int(inside.sum()) < _LEAST_PIXELS:
        raise InputError(
            f"{int(inside.sum())} pixels lie inside the object's outline: give a larger picture, or move the camera"
        )
    radiance = image[inside].double()
    if not bool((radiance > 0).any()):
        raise InputError("the picture is black where the object is: check its camera and its light")
    rows = inside[frozen.mask].nonzero()[:, 0]
    return Observation(frozen, rows, radiance, None if light is None else light.detach())


def _inner(coverage: torch.Tensor) -> torch.Tensor:
    """Pixels [H, W] that are covered whole, as are their eight neighbors: an outline is never where it should be."""
    partial = torch.nn.functional.pad((coverage < 1).float()[None, None], (1, 1, 1, 1), value=1.0)
    return torch.nn.functional.max_pool2d(partial, 3, stride=1)[0, 0] == 0
