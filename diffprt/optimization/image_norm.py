"""The image error to expect over random views and lights, as a quadratic form of the transfer: nothing is rendered.

A pixel is a weighted sum of its three receivers, so that the squared error of a picture under the light L is
|B E L|², with E the error of transfer [V, K] and B the barycentric weights [N, V]. Over lights of second moment P and
over views it is, in the mean,

    tr(Eᵀ M E P),   M = mean over views of Bᵀ B  [V, V], P = mean of L Lᵀ.

M is the mass matrix of linear finite elements, weighted by how large each triangle is seen: neighbors whose errors
have opposite signs cancel in the picture, and receivers that are never seen do not count.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from scipy.sparse import csr_matrix, identity

from diffprt.representation import Elements
from diffprt.scene import Camera
from diffprt.surface.operator import StoredOperator

# What receivers count that no view shows, as a share of the mean: others may show them.
_UNSEEN = 0.01


class ImageNorm:
    """<Y, M Y>: the squared error of pictures, summed over their pixels and averaged over views.

    Args:
        operator: M [V, V], symmetric and positive definite.
    """

    def __init__(self, operator: StoredOperator) -> None:
        self.operator = operator

    @staticmethod
    def of(elements: Elements, cameras: Sequence[Camera], *, threads: int | None = None) -> ImageNorm:
        """Rasterizes `elements` from all cameras.

        Returns:
            the norm, scaled so that the mean of M's diagonal is 1.

        Raises:
            InputError: they cannot be drawn.
        """
        total = csr_matrix((len(elements), len(elements)))
        for camera in cameras:
            view = elements.view(camera, threads=threads)
            corners, weights = view.index.numpy(), view.weight.double().numpy()
            start = np.arange(0, corners.size + 1, corners.shape[1])
            pixels = csr_matrix((weights.ravel(), corners.ravel(), start), shape=(len(corners), len(elements)))
            total = total + pixels.T @ pixels
        mean = total.diagonal().mean() or 1.0
        return ImageNorm.from_matrix(total / mean + _UNSEEN * identity(len(elements), format="csr"))

    @staticmethod
    def from_matrix(matrix: csr_matrix) -> ImageNorm:
        """The norm of a symmetric sparse matrix [V, V]."""
        return ImageNorm(StoredOperator.of(matrix.tocsr().astype(np.float32)))

    def apply(self, values: torch.Tensor) -> torch.Tensor:
        """M Y of `values` [V, D]."""
        return self.operator.product(values)

    def squared(self, values: torch.Tensor) -> torch.Tensor:
        """<Y, M Y> of `values` [V, D], a scalar; gradients reach them."""
        return _Quadratic.apply(self.operator, values)


class _Quadratic(torch.autograd.Function):
    """yᵀ M y for a symmetric M: the product of the forward pass is half the gradient of the backward one."""

    @staticmethod
    def forward(ctx, operator: StoredOperator, values: torch.Tensor) -> torch.Tensor:
        product = operator.product(values)
        ctx.save_for_backward(product)
        return (values * product).sum()

    @staticmethod
    def backward(ctx, gradient: torch.Tensor):
        (product,) = ctx.saved_tensors
        return None, 2 * gradient * product
