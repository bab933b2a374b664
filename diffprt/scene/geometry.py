"""All meshes of a scene as one: what is traced and shaded."""

from __future__ import annotations

from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Geometry:
    """All meshes of a scene in one, in order.

    Attributes:
        positions, normals, albedo: float32 [V, 3]; albedo may carry gradients.
        transmission: float32 [V] in [0, 1], see `Material.transmission`; 0 on occluder-only meshes.
        faces: int64 [F, 3].
        mesh_of_vertex: int64 [V], mesh_of_face: int64 [F], the index of the mesh each comes from.
    """

    positions: torch.Tensor
    normals: torch.Tensor
    faces: torch.Tensor
    mesh_of_vertex: torch.Tensor
    mesh_of_face: torch.Tensor
    albedo: torch.Tensor
    transmission: torch.Tensor
