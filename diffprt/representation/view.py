"""What a camera sees of elements. Frozen; what is summed over it is differentiable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch

from diffprt.representation.moving import moved

# Values of so few numbers are gathered before they are weighed; wider ones are summed row by row in one step.
_NARROW = 8


@dataclass(frozen=True)
class Samples:
    """N points of surfaces, and the S elements that each sees.

    Attributes:
        index: int64 [N, S], elements.
        weight: float32 [N, S], how much of each; a mean of elements where a row sums to 1.
        points, normals: float64 [N, 3] of the surface there; normals may have any length.
    """

    index: torch.Tensor
    weight: torch.Tensor
    points: torch.Tensor
    normals: torch.Tensor

    def mixed(self, values: torch.Tensor) -> torch.Tensor:
        """Weighted sums [N, ...] of what elements hold, [E, ...]; gradients reach the values."""
        return weighted_sums(values, self.index, self.weight)


@dataclass(frozen=True)
class View:
    """Elements as a camera sees them, N samples at the pixel centers that see any.

    Attributes:
        element_positions, element_normals: float [E, 3].
        index: int64 [N, S], elements that each sample sees: 3 corners of a triangle, one face cluster, k splats.
        weight: float32 [N, S].
        mask: bool [H, W], whether the pixel sees any; samples come row by row.
        depth: float32 [H, W] along the viewing axis, scene units; infinite where there is none.
    """

    element_positions: torch.Tensor
    element_normals: torch.Tensor
    index: torch.Tensor
    weight: torch.Tensor
    mask: torch.Tensor
    depth: torch.Tensor

    def to(self, device: torch.device | str) -> View:
        """On another device; weights and depth keep their precision."""
        return moved(self, device)

    @cached_property
    def points(self) -> torch.Tensor:
        """Where the surface is, float64 [N, 3]: the elements' weighted mean, unless a kind knows better."""
        return weighted_sums(self.element_positions.double(), self.index, self.weight)

    @cached_property
    def normals(self) -> torch.Tensor:
        """Its normal, float64 [N, 3], of any length."""
        return weighted_sums(self.element_normals.double(), self.index, self.weight)

    def samples(self, rows: slice = slice(None), index: torch.Tensor | None = None) -> Samples:
        """Some of the samples; `index` [N, S] names their elements in another count, of those picked, say."""
        index = self.index if index is None else index
        return Samples(index[rows], self.weight[rows], self.points[rows], self.normals[rows])

    def interpolate(self, values: torch.Tensor) -> torch.Tensor:
        """[H, W, C] from what elements hold, `values` [E, C]; gradients reach them. Empty pixels are 0."""
        return self.framed(weighted_sums(values, self.index, self.weight))

    def framed(self, values: torch.Tensor) -> torch.Tensor:
        """The picture [H, W, C] of the samples' `values` [N, C], 0 elsewhere; gradients reach them."""
        empty = values.new_zeros(*self.mask.shape, *values.shape[1:])
        return empty.index_put((self.mask,), values)


def weighted_sums(values: torch.Tensor, index: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Σ_s weight[n, s] values[index[n, s]], [N, ...], in the dtype of `values` [E, ...]; gradients reach them."""
    weight = weight.to(values.dtype)
    if values[:1].numel() <= _NARROW:
        return (values[index] * weight.reshape(*weight.shape, *(1,) * (values.dim() - 1))).sum(1)
    table = torch.nn.functional.embedding_bag(index, values.flatten(1), mode="sum", per_sample_weights=weight)
    return table.unflatten(1, values.shape[1:])
