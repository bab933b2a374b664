"""The scene as transfer sees it: triangles that occlude, and the vertices among them that reflect."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh
from diffprt.scene import Scene
from diffprt.scene.resolution import offset_remark
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern


@dataclass(frozen=True)
class Surfaces:
    """All triangles of a scene, and its own receivers.

    Attributes:
        positions: float32 [N, 3], every vertex.
        faces: int64 [F, 3] into `positions`.
        receivers: vertices of meshes that are not occluder-only, with the triangles that connect them.
        receives: bool [N], the vertices that are receivers, in their order; others only block light.
        source_of_corner: int64 [F, 3], the receiver at each face corner; -1 on occluder-only meshes,
            which absorb what they block.
    """

    positions: torch.Tensor
    faces: torch.Tensor
    receivers: Receivers
    receives: torch.Tensor
    source_of_corner: torch.Tensor

    @staticmethod
    def of(scene: Scene) -> Surfaces:
        """Flattens the scene; vertex order is the order of its meshes and of their vertices.

        Raises:
            InputError: no triangles, or a scene so far from the origin for its size that 32-bit coordinates do not
                resolve it.
        """
        geometry = scene.merged()
        if len(geometry.faces) == 0:
            raise InputError(f"scene '{scene.name}' has no triangles: load a mesh with faces")
        low, high = scene.bounds.numpy()
        offset_remark(low, high, scene.name)
        seen = torch.tensor([not mesh.occluder_only for mesh in scene.meshes])
        receives = seen[geometry.mesh_of_vertex.long()]
        index = torch.where(receives, receives.long().cumsum(0) - 1, -1)
        source_of_corner = index[geometry.faces]
        own_faces = source_of_corner[seen[geometry.mesh_of_face.long()]]
        through = geometry.transmission[receives]
        receivers = Receivers(
            geometry.positions[receives],
            geometry.normals[receives],
            geometry.albedo[receives],
            own_faces,
            through if bool(through.any()) else None,
        )
        return Surfaces(geometry.positions, geometry.faces, receivers, receives, source_of_corner)

    def mesh(self, threads: int | None = None) -> TriangleMesh:
        """The triangles to trace against: built once, on `threads` CPU threads (all without), and not pickled."""
        if "_mesh" not in self.__dict__:
            self.__dict__["_mesh"] = TriangleMesh(self.positions, self.faces, threads=threads)
        return self.__dict__["_mesh"]

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name != "_mesh"}

    def pattern(self, receivers: Receivers, rays: int, seed: int) -> Pattern:
        """Directions of `rays` rays for any receivers; see `Receivers.scramble`."""
        return Pattern.create(rays, self.scramble(receivers, seed))

    def scramble(self, receivers: Receivers, seed: int) -> torch.Tensor:
        """`Receivers.scramble` in the box of these surfaces, int64 [V]."""
        return receivers.scramble(seed, self.positions.amin(0), self.diagonal)

    @property
    def diagonal(self) -> float:
        """Length of the box's diagonal, scene units."""
        return float((self.positions.amax(0) - self.positions.amin(0)).norm())

    @property
    def colored(self) -> bool:
        """Whether some surface reflects the three channels differently."""
        albedo = self.receivers.albedo
        return bool((albedo != albedo[:, :1]).any())
