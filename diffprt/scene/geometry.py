"""All meshes of a scene as one: what is traced and shaded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch


@dataclass(frozen=True)
class Geometry:
    """All meshes of a scene in one, in order.

    Attributes:
        positions, normals, albedo: float32 [V, 3]; albedo may carry gradients.
        transmission: float32 [V] in [0, 1], see `Material.transmission`; 0 on occluder-only meshes.
        faces: int64 [F, 3].
        mesh_of_vertex: int64 [V], mesh_of_face: int64 [F], the index of the mesh each comes from.
        back_of_vertex: int64 [V], the vertex that stands for the other side of each, -1 for none; None unless made by
            `with_backs`.
    """

    positions: torch.Tensor
    normals: torch.Tensor
    faces: torch.Tensor
    mesh_of_vertex: torch.Tensor
    mesh_of_face: torch.Tensor
    albedo: torch.Tensor
    transmission: torch.Tensor
    back_of_vertex: torch.Tensor | None = None

    def with_backs(self) -> Geometry:
        """With a vertex of opposite normal behind all others for each translucent one, in order; no face has it."""
        sheets = self.transmission.nonzero()[:, 0]
        count = len(self.positions)
        back = torch.full((count + len(sheets),), -1)
        back[sheets] = count + torch.arange(len(sheets))
        return replace(
            self,
            positions=torch.cat([self.positions, self.positions[sheets]]),
            normals=torch.cat([self.normals, -self.normals[sheets]]),
            albedo=torch.cat([self.albedo, self.albedo[sheets]]),
            transmission=torch.cat([self.transmission, self.transmission[sheets]]),
            mesh_of_vertex=torch.cat([self.mesh_of_vertex, self.mesh_of_vertex[sheets]]),
            back_of_vertex=back,
        )
