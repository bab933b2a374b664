"""Triangle meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.scene.material import Material
from diffprt.scene.normals import smooth_normals


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh; make one with `Mesh.create`. The order of the vertices is that of the input.

    Attributes:
        positions: float32 [V, 3], scene units, +y up.
        faces: int64 [F, 3], counter-clockwise seen from the front.
        normals: float32 [V, 3], unit.
        uv: float32 [V, 2] or None; v = 0 is the top row of a texture.
        colors: float32 [V, 3] or None, linear RGB in [0, 1] that multiplies the albedo.
        material: index into the scene's materials.
        name: for messages.
        occluder_only: blocks light and absorbs it; it is not shown.
        ground: made by `Scene.with_ground`.
        computed_normals: the normals follow from positions and faces.
    """

    positions: torch.Tensor
    faces: torch.Tensor
    normals: torch.Tensor
    uv: torch.Tensor | None = None
    colors: torch.Tensor | None = None
    material: int = 0
    name: str = "mesh"
    occluder_only: bool = False
    ground: bool = False
    computed_normals: bool = False

    @staticmethod
    def create(
        positions: torch.Tensor | np.ndarray,
        faces: torch.Tensor | np.ndarray,
        normals: torch.Tensor | np.ndarray | None = None,
        *,
        uv: torch.Tensor | np.ndarray | None = None,
        colors: torch.Tensor | np.ndarray | None = None,
        material: int = 0,
        name: str = "mesh",
        occluder_only: bool = False,
        ground: bool = False,
    ) -> Mesh:
        """A mesh from tensors, arrays or lists, shapes as in the attributes.

        Args:
            normals: any length but zero; None computes angle-weighted smooth normals, which coincident
                vertices (seams) share.

        Geometry carries no gradients; `colors` may. Only shapes are checked here: `diffprt.scene.checks`
        repairs, and `Scene.load` and `Scene.from_mesh` call it.

        Raises:
            InputError: a wrong shape, or normals that are zero or not finite.
        """
        positions = _array(positions, "positions", name, (None, 3)).astype(np.float32)
        faces = _array(faces, "faces", name, (None, 3)).astype(np.int64)
        count = len(positions)
        if len(faces) and not 0 <= faces.min() <= faces.max() < count:
            raise InputError(f"mesh '{name}' has faces that name vertices outside 0..{count - 1}: repair the mesh")
        computed = normals is None
        if normals is None:
            normals = smooth_normals(positions, faces)
        else:
            normals = _array(normals, "normals", name, (count, 3)).astype(np.float64)
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            bad = int((~(np.isfinite(length) & (length > 1e-12))).sum())
            if bad:
                raise InputError(f"mesh '{name}' has {bad} normals that are zero or not finite: leave normals out")
            normals = (normals / length).astype(np.float32)
        if uv is not None:
            uv = torch.from_numpy(_array(uv, "uv", name, (count, 2)).astype(np.float32))
        if colors is not None:
            colors = torch.as_tensor(colors, dtype=torch.float32)
            if tuple(colors.shape) != (count, 3):
                raise InputError(f"mesh '{name}' has colors of shape {tuple(colors.shape)}: give [{count}, 3]")
        return Mesh(
            positions=torch.from_numpy(positions),
            faces=torch.from_numpy(faces),
            normals=torch.from_numpy(normals),
            uv=uv,
            colors=colors,
            material=material,
            name=name,
            occluder_only=occluder_only,
            ground=ground,
            computed_normals=computed,
        )

    def vertex_albedo(self, materials: Sequence[Material]) -> torch.Tensor:
        """Albedo [V, 3] at the vertices: factor, texture and vertex colour multiplied.

        A texture is left out where the mesh has no uv. Gradients reach factor, texture and colours.
        """
        material = materials[self.material]
        uv = self.uv
        albedo = material.albedo.expand(len(self.positions), 3) if uv is None else material.sample(uv)
        return albedo if self.colors is None else albedo * self.colors


def _array(values: object, what: str, name: str, shape: tuple) -> np.ndarray:
    """A fresh array (never a view of the caller's memory) of the wanted shape."""
    if isinstance(values, torch.Tensor):
        values = values.detach().cpu().numpy()
    array = np.array(values)
    if array.size == 0 and shape[0] is None:
        array = array.reshape(0, shape[1])
    if array.ndim != 2 or array.shape[1] != shape[1] or shape[0] not in (None, array.shape[0]):
        wanted = f"[{'N' if shape[0] is None else shape[0]}, {shape[1]}]"
        raise InputError(f"mesh '{name}' has {what} of shape {array.shape}: give {wanted}")
    return array
