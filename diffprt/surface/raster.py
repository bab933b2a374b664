"""Which triangle each pixel sees, by rasterization in Warp."""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.kernels.raster import rasterize
from diffprt.scene.camera import Camera


def triangles_in_view(
    positions: torch.Tensor, faces: torch.Tensor, camera: Camera, *, threads: int | None = None
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Triangles at the pixel centers of `camera`.

    Args:
        positions: [V, 3], scene units.
        faces: int64 [F, 3].

    Returns:
        corners int64 [N, 3] and perspective-correct barycentric weights float32 [N, 3] of the pixels that see one,
        which pixels these are, bool [H, W], and depth float32 [H, W] along the viewing axis, infinite elsewhere.

    Raises:
        InputError: there are no triangles.
    """
    if len(faces) == 0:
        raise InputError("these receivers are points without triangles: render an asset baked at mesh vertices")
    homogeneous = torch.cat([positions.double(), torch.ones(len(positions), 1)], dim=1)
    matrix = camera.projection(*camera.depth_range(positions)) @ camera.view()
    face, barycentrics, depth = rasterize(homogeneous @ matrix.T, faces, camera.width, camera.height, threads=threads)
    mask = face >= 0
    return faces[face[mask].long()], barycentrics[mask], mask, depth
