"""A rasterized view: which triangle each pixel sees. Frozen; what is interpolated over it is differentiable."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.errors import InputError
from diffprt.kernels.raster import rasterize
from diffprt.scene.camera import Camera
from diffprt.surface import Receivers


@dataclass(frozen=True)
class View:
    """The receivers' triangles as a camera sees them, one sample per pixel center.

    Attributes:
        corners: int64 [H, W, 3], the receivers at the corners of the visible triangle; 0 where there is none.
        barycentrics: float32 [H, W, 3], perspective-correct; 0 where there is no triangle.
        mask: bool [H, W], whether the pixel sees a triangle.
        depth: float32 [H, W] along the viewing axis, scene units; infinite where there is no triangle.
    """

    corners: torch.Tensor
    barycentrics: torch.Tensor
    mask: torch.Tensor
    depth: torch.Tensor

    @staticmethod
    def of(receivers: Receivers, camera: Camera, *, threads: int | None = None) -> View:
        """Rasterizes; raises InputError when the receivers have no triangles."""
        if len(receivers.faces) == 0:
            raise InputError("these receivers are points without triangles: render an asset baked at mesh vertices")
        homogeneous = torch.cat([receivers.positions.double(), torch.ones(len(receivers), 1)], dim=1)
        matrix = camera.projection(*camera.depth_range(receivers.positions)) @ camera.view()
        face, barycentrics, depth = rasterize(
            homogeneous @ matrix.T, receivers.faces, camera.width, camera.height, threads=threads
        )
        mask = face >= 0
        corners = receivers.faces[face.clamp_min(0).long()]
        return View(corners * mask[..., None], barycentrics, mask, depth)

    def interpolate(self, values: torch.Tensor) -> torch.Tensor:
        """[H, W, C] from per-receiver `values` [V, C]; gradients reach `values`. Empty pixels are 0."""
        return (values[self.corners] * self.barycentrics.to(values.dtype)[..., None]).sum(-2)
