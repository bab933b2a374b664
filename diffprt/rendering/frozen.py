"""A view that is rasterized once and kept: pixels as a constant sparse product of what elements send.

An optimizer draws the same views again and again. Which elements a pixel sees, with which weights and from which
direction does not depend on signal, light or material, so it is found once. Pixels are P x, with x [S B, 3] the
coefficients of the S elements in sight and P [N, S B] the mean over a pixel's samples of weight times basis. The
gradient is Pᵀ g. Elements out of sight are never shaded. Silhouettes are frozen: no gradient reaches the camera or the
positions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
import torch

from diffprt.errors import InputError
from diffprt.representation.elements import Elements
from diffprt.representation.interface import Representation
from diffprt.representation.lighting import LightsLike, each_of
from diffprt.representation.lit import Basis, ConstantBasis, Lit
from diffprt.representation.view import View
from diffprt.scene.camera import Camera
from diffprt.surface.operator import StoredOperator


@dataclass(frozen=True)
class FrozenView:
    """What a camera sees of some elements, ready to be drawn many times.

    Attributes:
        elements: all of them, E; where they are counts, their albedo does not.
        camera: where from.
        view: its samples, [H s, W s] with s = `samples`.
        samples: samples a side of each pixel, which is their mean over black.
        coverage: float32 [H, W], share of each pixel's samples that see an element.
        mask: bool [H, W], whether it is above 0. N pixels, counted row by row.
        seen: int64 [S], ascending, the elements in sight.
    """

    elements: Elements
    camera: Camera
    view: View
    samples: int
    coverage: torch.Tensor
    mask: torch.Tensor
    seen: torch.Tensor

    @staticmethod
    def of(elements: Elements, camera: Camera, *, samples: int = 1, threads: int | None = None) -> FrozenView:
        """Rasterizes; raises InputError when the elements cannot be drawn, or the camera sees none."""
        if not 1 <= samples <= 16:
            raise InputError(f"samples is {samples}: give 1 to 16 a side")
        fine = replace(camera, width=camera.width * samples, height=camera.height * samples)
        view = elements.view(fine, threads=threads)
        if not bool(view.mask.any()):
            raise InputError(f"the camera at {camera.eye} sees none of {len(elements)} receivers: aim it at the asset")
        coverage = view.mask.reshape(camera.height, samples, camera.width, samples).float().mean(dim=(1, 3))
        return FrozenView(elements, camera, view, samples, coverage, coverage > 0, view.index.unique())

    def to(self, device: torch.device | str) -> FrozenView:
        """On another device, where the elements' assets are; its operators are made again."""
        moved = {name: getattr(self, name).to(device) for name in ("elements", "view", "coverage", "mask", "seen")}
        return replace(self, **moved)

    def radiance(self, lit: Lit) -> torch.Tensor:
        """Radiance of the pixels, [N, 3] or [N, 3 B] under B lights, from the lit elements in sight; gradients reach
        its coefficients."""
        rows = self._checked(lit.coefficients).transpose(1, 2)
        return self.operator(lit.basis).gather(rows.reshape(-1, rows.shape[2]))

    def pixels(self, values: torch.Tensor) -> torch.Tensor:
        """[N, C] from `values` [S, C] of the elements in sight, interpolated and averaged; gradients reach them."""
        return self.operator(ConstantBasis()).gather(self._checked(values))

    def framed(self, pixels: torch.Tensor) -> torch.Tensor:
        """The picture [H, W, C] of `pixels` [N, C], 0 elsewhere; gradients reach them."""
        empty = pixels.new_zeros(self.mask.numel(), pixels.shape[-1])
        return empty.index_copy(0, self.index, pixels).unflatten(0, self.mask.shape)

    def image(self, values: torch.Tensor) -> torch.Tensor:
        """The picture [H, W, C] of `values` [S, C] of the elements in sight; gradients reach them."""
        return self.framed(self.pixels(values))

    @cached_property
    def index(self) -> torch.Tensor:
        """Where the pixels of the mask are, int64 [N], counted row by row."""
        return self.mask.flatten().nonzero()[:, 0]

    def operator(self, basis: Basis) -> StoredOperator:
        """P [N, S B] for a basis; kept for the next time."""
        kept = self.__dict__.setdefault("_operators", {})
        if basis not in kept:
            kept[basis] = self._operator(basis)
        return kept[basis]

    def _operator(self, basis: Basis) -> StoredOperator:
        """Mean over each pixel's samples of weights times what the basis has there."""
        index = torch.searchsorted(self.seen, self.view.index)
        eye = torch.tensor(self.camera.eye, dtype=torch.float64)
        values = basis.at(self.view.samples(index=index), eye)
        weights = self.view.weight.double()[..., None] * (values[:, None] if values.dim() == 2 else values)
        pixel = (self.mask.flatten().cumsum(0) - 1).reshape(self.mask.shape)
        for axis in (0, 1):
            pixel = pixel.repeat_interleave(self.samples, axis)
        each, width = weights.shape[1:]
        columns = (index[..., None] * width + torch.arange(width)).flatten()
        rows = pixel[self.view.mask].repeat_interleave(each * width)
        shape = (int(self.mask.sum()), len(self.seen) * width)
        values = (weights / self.samples**2).flatten()
        matrix = scipy.sparse.csr_array((values.numpy(), (rows.numpy(), columns.numpy())), shape=shape)
        return StoredOperator.of(matrix.astype(np.float32))

    def _checked(self, values: torch.Tensor) -> torch.Tensor:
        if len(values) != len(self.seen):
            raise InputError(f"values are of {len(values)} elements, {len(self.seen)} are in sight: give values[seen]")
        return values


def pixel_radiance(
    asset: Representation, light: LightsLike, frozen: FrozenView, *, albedo: torch.Tensor | None = None
) -> torch.Tensor:
    """Linear radiance of the masked pixels of `frozen`, [N, 3], or [B, N, 3] of a batch of lights; see `picture`."""
    if len(asset.elements) != len(frozen.elements):
        raise InputError(
            f"asset has {len(asset.elements)} elements, the view was frozen with {len(frozen.elements)}: "
            "freeze it again with FrozenView.of(asset.elements, camera)"
        )
    part = asset.picked(frozen.seen)
    albedo, (each, batch) = None if albedo is None else albedo[frozen.seen], each_of(light)
    if not batch:
        return frozen.radiance(part.lit(each[0], albedo=albedo))
    return frozen.radiance(part.lit_each(each, albedo=albedo)).unflatten(1, (-1, 3)).transpose(0, 1)


def picture(
    asset: Representation, light: LightsLike, frozen: FrozenView, *, albedo: torch.Tensor | None = None
) -> torch.Tensor:
    """A picture of the asset from a frozen view, as `render` draws it over black.

    Args:
        asset: any representation, at the elements of `frozen`.
        light: as for `render`, one or a batch.
        albedo: [E, 3], of assets that leave it out of their signal; without it, the elements' own.

    Returns:
        [H, W, 3] linear radiance [W/m²/sr], [B, H, W, 3] of a batch. Gradients reach the asset's signal, light and
        albedo; elements out of sight get 0.

    Raises:
        InputError: another number of elements, a light of another order or kind, a glossy asset with albedo.
    """
    pixels = pixel_radiance(asset, light, frozen, albedo=albedo)
    return frozen.framed(pixels) if pixels.dim() == 2 else torch.stack([frozen.framed(one) for one in pixels])
