"""A view that is rasterized once and kept: pixels as a constant sparse product of what receivers send.

An optimizer draws the same views again and again. Which triangle a pixel sees, with which weights and from which
direction does not depend on signal, light or material, so it is found once. Pixels are P x, with x [S, ...] what the S
receivers in sight send: their radiance, or its coefficients by mirrored direction (`diffprt.shading.mirrored`) where
they are glossy. The gradient is Pᵀ g. Receivers out of sight are never shaded. Silhouettes are frozen: no gradient
reaches the camera or the positions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
import torch

from diffprt import sh
from diffprt.compression import ClusteredTransfer, GlossyAsset
from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.shading import mirrored_basis, mirrored_radiance, shade
from diffprt.surface import Receivers
from diffprt.surface.operator import OperatorRows, StoredOperator
from diffprt.surface.view import View
from diffprt.transfer import Transfer

# What assets hold for each receiver; means and bases are shared by all.
_PER_RECEIVER = ("diffuse", "glossy", "labels", "weights", "openness", "bent_normals")


@dataclass(frozen=True)
class FrozenView:
    """What a camera sees of some receivers, ready to be drawn many times.

    Attributes:
        receivers: all of them, V; positions, normals and triangles count, their albedo does not.
        camera: where from.
        view: its samples, [H s, W s] with s = `samples`.
        samples: samples a side of each pixel, which is their mean over black.
        coverage: float32 [H, W], share of each pixel's samples that see a triangle.
        mask: bool [H, W], whether it is above 0. N pixels, counted row by row.
        seen: int64 [S], ascending, the receivers at the corners of visible triangles.
    """

    receivers: Receivers
    camera: Camera
    view: View
    samples: int
    coverage: torch.Tensor
    mask: torch.Tensor
    seen: torch.Tensor

    @staticmethod
    def of(receivers: Receivers, camera: Camera, *, samples: int = 1, threads: int | None = None) -> FrozenView:
        """Rasterizes; raises InputError when the receivers have no triangles, or none that the camera sees."""
        if not 1 <= samples <= 16:
            raise InputError(f"samples is {samples}: give 1 to 16 a side")
        fine = replace(camera, width=camera.width * samples, height=camera.height * samples)
        view = View.of(receivers, fine, threads=threads)
        if not bool(view.mask.any()):
            raise InputError(f"the camera at {camera.eye} sees none of {len(receivers)} receivers: aim it at the asset")
        coverage = view.mask.reshape(camera.height, samples, camera.width, samples).float().mean(dim=(1, 3))
        seen = view.corners[view.mask].unique()
        return FrozenView(receivers, camera, view, samples, coverage, coverage > 0, seen)

    def pixels(self, values: torch.Tensor) -> torch.Tensor:
        """[N, C] from `values` [S, C] of the receivers in sight, interpolated and averaged; gradients reach them."""
        return self.operator.gather(self._checked(values))

    def mirrored_pixels(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Radiance [N, 3] from `coefficients` [S, 3, K_out] of `mirrored_radiance`, of the receivers in sight;
        gradients reach them."""
        operator = self.mirrored_operator(sh.order_of_count(self._checked(coefficients).shape[-1]))
        return operator.gather(coefficients.transpose(1, 2).reshape(-1, coefficients.shape[1]))

    def framed(self, pixels: torch.Tensor) -> torch.Tensor:
        """The picture [H, W, C] of `pixels` [N, C], 0 elsewhere; gradients reach them."""
        empty = pixels.new_zeros(self.mask.numel(), pixels.shape[-1])
        return empty.index_copy(0, self.index, pixels).unflatten(0, self.mask.shape)

    def image(self, values: torch.Tensor) -> torch.Tensor:
        """The picture [H, W, C] of `values` [S, C] of the receivers in sight; gradients reach them."""
        return self.framed(self.pixels(values))

    @cached_property
    def index(self) -> torch.Tensor:
        """Where the pixels of the mask are, int64 [N], counted row by row."""
        return self.mask.flatten().nonzero()[:, 0]

    @cached_property
    def operator(self) -> StoredOperator:
        """P [N, S], barycentric weights."""
        return self._operator(self._corner_weights[..., None])

    def mirrored_operator(self, order: int) -> StoredOperator:
        """P [N, S K_out], weights times SH of `order` at each sample's mirrored direction; kept for the next time."""
        kept = self.__dict__.setdefault("_mirrored", {})
        if order not in kept:
            corners, weights = self.view.corners[self.view.mask], self._corner_weights[..., None]
            surfaces = (self.receivers.positions, self.receivers.normals)
            point, normal = ((weights * values.double()[corners]).sum(1) for values in surfaces)
            basis = mirrored_basis(point, normal, torch.tensor(self.camera.eye, dtype=torch.float64), order)
            kept[order] = self._operator(weights * basis[:, None, :])
        return kept[order]

    @cached_property
    def _corner_weights(self) -> torch.Tensor:
        """Barycentric weights of the samples in sight, float64 [samples, 3]."""
        return self.view.barycentrics[self.view.mask].double()

    def _operator(self, weights: torch.Tensor) -> StoredOperator:
        """Mean over each pixel's samples of `weights` [samples in sight, 3 corners, columns of a receiver]."""
        pixel = (self.mask.flatten().cumsum(0) - 1).reshape(self.mask.shape)
        for axis in (0, 1):
            pixel = pixel.repeat_interleave(self.samples, axis)
        width = weights.shape[2]
        columns = torch.searchsorted(self.seen, self.view.corners[self.view.mask])[..., None] * width
        columns = (columns + torch.arange(width)).flatten()
        rows = pixel[self.view.mask].repeat_interleave(3 * width)
        shape = (int(self.mask.sum()), len(self.seen) * width)
        values = (weights / self.samples**2).flatten()
        matrix = scipy.sparse.csr_array((values.numpy(), (rows.numpy(), columns.numpy())), shape=shape)
        matrix.sort_indices()
        entries = OperatorRows(
            np.diff(matrix.indptr).astype(np.int32), matrix.indices.astype(np.int32), matrix.data.astype(np.float32)
        )
        return StoredOperator([entries], shape[1])

    def _checked(self, values: torch.Tensor) -> torch.Tensor:
        if len(values) != len(self.seen):
            raise InputError(f"values are of {len(values)} receivers, {len(self.seen)} are in sight: give values[seen]")
        return values


def pixel_radiance(
    asset: Transfer | ClusteredTransfer | GlossyAsset,
    light: Light | torch.Tensor,
    frozen: FrozenView,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """Linear radiance of the masked pixels of `frozen`, [N, 3]; see `picture`."""
    if len(asset.receivers) != len(frozen.receivers):
        raise InputError(
            f"asset has {len(asset.receivers)} receivers, the view was frozen with {len(frozen.receivers)}: "
            "freeze it again with FrozenView.of(asset.receivers, camera)"
        )
    part = in_sight(asset, frozen.seen)
    if not isinstance(asset, GlossyAsset):
        albedo = part.receivers.albedo if albedo is None else albedo[frozen.seen]
        return frozen.pixels(shade(part, light, albedo=albedo))
    if albedo is not None:
        raise InputError("a glossy asset has its reflectance inside: leave albedo out, or bake with another brdf")
    return frozen.mirrored_pixels(mirrored_radiance(part, light))


def picture(
    asset: Transfer | ClusteredTransfer | GlossyAsset,
    light: Light | torch.Tensor,
    frozen: FrozenView,
    *,
    albedo: torch.Tensor | None = None,
) -> torch.Tensor:
    """A picture of the asset from a frozen view, as `render` draws it over black.

    Args:
        asset: diffuse or glossy transfer, plain or clustered, at the receivers of `frozen`.
        light: a `Light` or its coefficients [K, 3], of the asset's order.
        albedo: [V, 3], of diffuse assets only; without it, the receivers' own.

    Returns:
        [H, W, 3] linear radiance [W/m²/sr]. Gradients reach transfer or means, bases and weights, light and albedo;
        receivers out of sight get 0.

    Raises:
        InputError: another number of receivers, a light of another order, a glossy asset with albedo.
    """
    return frozen.framed(pixel_radiance(asset, light, frozen, albedo=albedo))


def in_sight(asset: Transfer | ClusteredTransfer | GlossyAsset, seen: torch.Tensor):
    """The asset at the receivers `seen`, int64 [S], alone, without triangles; gradients pass through."""
    rows = {name: getattr(asset, name)[seen] for name in _PER_RECEIVER if getattr(asset, name, None) is not None}
    return replace(asset, receivers=asset.receivers.picked(seen), **rows)
