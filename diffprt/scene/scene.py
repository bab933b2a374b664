"""Scenes: what is baked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from diffprt.brdf import Brdf
from diffprt.errors import InputError
from diffprt.scene.assembly import assembled
from diffprt.scene.builtin import builtin_meshes
from diffprt.scene.checks import DefectReport, check_mesh
from diffprt.scene.digest import scene_digest
from diffprt.scene.geometry import Geometry
from diffprt.scene.ground import ground_mesh
from diffprt.scene.material import Material
from diffprt.scene.mesh import Mesh
from diffprt.scene.readers.loading import read_parts
from diffprt.scene.readers.parts import DEFAULT_ALBEDO, Part, Parts

_BUILTIN = "builtin:"


@dataclass(frozen=True)
class Scene:
    """Meshes and their materials, +y up, with what was found wrong in them.

    Attributes:
        meshes: at least one.
        materials: each mesh names one by index.
        name: for messages and files.
        defects: what loading repaired and reports.
    """

    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    name: str = "scene"
    defects: DefectReport = field(default_factory=DefectReport)

    def __post_init__(self) -> None:
        if not self.meshes:
            raise InputError(f"scene '{self.name}' has no meshes: give at least one")
        for mesh in self.meshes:
            if not 0 <= mesh.material < len(self.materials):
                raise InputError(f"mesh '{mesh.name}' has material {mesh.material}, of {len(self.materials)}: add it")

    @staticmethod
    def load(
        path: str | Path,
        *,
        up: str | None = None,
        non_finite: str = "refuse",
        winding: str = "repair",
        recenter: bool = False,
    ) -> Scene:
        """Loads .glb, .gltf, .obj, .ply, .stl, .usd, .usda, .usdc or .usdz, or "builtin:NAME".

        Args:
            path: the file.
            up: the axis of the file that points up, "y", "z", "x" or one of them with "-". None is +y, and
                for USD the stage's own.
            non_finite: "refuse" non-finite vertices, or "drop" their faces.
            winding: "repair", or "keep" for rooms that are seen from within.
            recenter: move the scene to the origin before its coordinates are rounded to 32 bits; a remark in
                `defects` says by how much.

        Vertices keep the order of the file. `diffprt.scene.checks.POLICY` says what is repaired.

        Raises:
            InputError: the file is missing, unreadable, no mesh, or its mesh is refused.
        """
        if str(path).startswith(_BUILTIN):
            if (up, non_finite, winding, recenter) != (None, "refuse", "repair", False):
                raise InputError(f"scene {path} is built in and sound: leave out up, non_finite, winding and recenter")
            return builtin_scene(str(path)[len(_BUILTIN) :])
        path = Path(path)
        parts = read_parts(path).turned_up(up)
        parts = parts.recentered() if recenter else parts
        try:
            meshes, materials, report = assembled(parts, name=path.stem, non_finite=non_finite, winding=winding)
        except InputError as error:
            raise error.of(path) from error.__cause__
        return Scene(meshes, materials, path.stem, report)

    @staticmethod
    def from_mesh(
        positions: torch.Tensor | np.ndarray,
        faces: torch.Tensor | np.ndarray,
        normals: torch.Tensor | np.ndarray | None = None,
        *,
        albedo: torch.Tensor | float | tuple = DEFAULT_ALBEDO,
        uv: torch.Tensor | np.ndarray | None = None,
        colors: torch.Tensor | np.ndarray | None = None,
        transmission: float = 0.0,
        name: str = "mesh",
        non_finite: str = "refuse",
        winding: str = "repair",
        recenter: bool = False,
    ) -> Scene:
        """A scene of one mesh from tensors or arrays: positions [V, 3], faces [F, 3], normals [V, 3].

        `albedo` is a number or three, linear RGB, and receives gradients; `transmission` is as in `Material`. The rest
        is as in `load`.
        """
        arrays = [_plain(x) for x in (positions, faces, normals, uv, colors)]
        for what, values in zip(("positions", "faces"), arrays, strict=False):
            if values.size and (values.ndim != 2 or values.shape[1] != 3):
                raise InputError(f"mesh '{name}' has {what} of shape {values.shape}: give [N, 3]")
        if arrays[2] is not None and arrays[2].shape != arrays[0].shape:
            raise InputError(f"mesh '{name}' has normals of shape {arrays[2].shape}: give {arrays[0].shape}")
        parts = Parts([Part(*arrays, name=name)], [Material(albedo, transmission=transmission, name=name)])
        parts = parts.recentered() if recenter else parts
        meshes, materials, report = assembled(parts, name=name, non_finite=non_finite, winding=winding)
        return Scene(meshes, materials, name, report)

    @property
    def bounds(self) -> torch.Tensor:
        """Least and greatest corner of all meshes, float32 [2, 3]."""
        return _bounds(self.meshes)

    @property
    def object_bounds(self) -> torch.Tensor:
        """Bounds [2, 3] of what is looked at: without ground and occluders, unless there is nothing else."""
        return _bounds([m for m in self.meshes if not (m.ground or m.occluder_only)] or self.meshes)

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of `bounds`, scene units."""
        low, high = self.bounds.double()
        return float((high - low).norm())

    @property
    def triangle_count(self) -> int:
        """Triangles in all meshes."""
        return sum(len(mesh.faces) for mesh in self.meshes)

    @property
    def vertex_count(self) -> int:
        """Vertices in all meshes, occluders included."""
        return sum(len(mesh.positions) for mesh in self.meshes)

    def with_albedo(self, albedo: torch.Tensor | float | tuple) -> Scene:
        """The scene with one albedo everywhere, in place of factors, textures and vertex colours."""
        materials = tuple(material.with_albedo(albedo) for material in self.materials)
        return replace(self, materials=materials, meshes=tuple(replace(mesh, colors=None) for mesh in self.meshes))

    @property
    def glossy(self) -> bool:
        """Whether some material has a BRDF."""
        return any(material.brdf is not None for material in self.materials)

    def with_brdf(self, brdf: Brdf | Sequence[Brdf]) -> Scene:
        """The scene with one BRDF everywhere, or with one for each material; gradients reach their parameters.

        Raises:
            InputError: another number of BRDFs than materials.
        """
        brdfs = list(brdf) if isinstance(brdf, Iterable) and not isinstance(brdf, str) else [brdf]
        if wrong := [b for b in brdfs if not isinstance(b, Brdf)]:
            raise InputError(
                f"brdf is {wrong[0]!r}: give a diffprt.brdf.Brdf, such as GGX(0.3), or an object of your own subclass"
            )
        if len(brdfs) not in {1, len(self.materials)}:
            raise InputError(
                f"{len(brdfs)} BRDFs for {len(self.materials)} materials of scene '{self.name}': "
                "give one, or one per material"
            )
        each = brdfs * len(self.materials) if len(brdfs) == 1 else brdfs
        materials = tuple(replace(material, brdf=b) for material, b in zip(self.materials, each, strict=True))
        return replace(self, materials=materials)

    def with_ground(
        self,
        *,
        size: float = 3.0,
        resolution: int = 64,
        albedo: torch.Tensor | float | tuple = 0.5,
        clearance: float = 0.0,
    ) -> Scene:
        """The scene on a square that receives and casts, just under its lowest point.

        Args:
            size: length of a side, in diagonals of `object_bounds`.
            resolution: cells along a side; they are finer under the object.
            albedo: a number or three, linear RGB.
            clearance: distance below the lowest point, in diagonals; a ten-thousandth is always added.
        """
        if any(mesh.ground for mesh in self.meshes):
            raise InputError(f"scene '{self.name}' has a ground: one is enough, start from the scene without it")
        bounds = self.object_bounds.numpy()
        ground = ground_mesh(
            bounds, size=size, resolution=resolution, clearance=clearance, material=len(self.materials)
        )
        materials = (*self.materials, Material(albedo, name="ground"))
        return replace(self, meshes=(*self.meshes, ground), materials=materials)

    def with_occluder(self, occluder: Mesh | Scene) -> Scene:
        """The scene with geometry that blocks light and absorbs it, and is not shown.

        A mesh refers to the materials of this scene; a scene brings its own.
        """
        meshes, materials = ((occluder,), ()) if isinstance(occluder, Mesh) else (occluder.meshes, occluder.materials)
        shift = 0 if isinstance(occluder, Mesh) else len(self.materials)
        added = tuple(replace(mesh, occluder_only=True, material=mesh.material + shift) for mesh in meshes)
        return replace(self, meshes=(*self.meshes, *added), materials=(*self.materials, *materials))

    def transformed(self, matrix: torch.Tensor | np.ndarray) -> Scene:
        """The scene under an affine `matrix` [4, 4] on column vectors; a mirror turns the faces over."""
        matrix = np.asarray(_plain(matrix), dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-300:
            raise InputError(f"transform has shape {matrix.shape}: give an invertible [4, 4]")
        meshes = []
        for mesh in self.meshes:
            part = Part(*_arrays(mesh)).placed(matrix)
            moved = Mesh.create(part.positions, part.faces, part.normals, name=mesh.name)
            meshes.append(replace(mesh, positions=moved.positions, faces=moved.faces, normals=moved.normals))
        return replace(self, meshes=tuple(meshes))

    def merged(self) -> Geometry:
        """All meshes as one, in order. Gradients reach the materials through `albedo`."""
        counts = [len(mesh.positions) for mesh in self.meshes]
        offsets = np.cumsum([0, *counts[:-1]]).tolist()
        face_counts = [len(mesh.faces) for mesh in self.meshes]
        index = torch.arange(len(self.meshes))
        transmissions = [0.0 if m.occluder_only else self.materials[m.material].transmission for m in self.meshes]
        return Geometry(
            positions=torch.cat([mesh.positions for mesh in self.meshes]),
            normals=torch.cat([mesh.normals for mesh in self.meshes]),
            faces=torch.cat([mesh.faces + o for mesh, o in zip(self.meshes, offsets, strict=True)]),
            mesh_of_vertex=torch.repeat_interleave(index, torch.tensor(counts)),
            mesh_of_face=torch.repeat_interleave(index, torch.tensor(face_counts)),
            albedo=torch.cat([mesh.vertex_albedo(self.materials) for mesh in self.meshes]),
            transmission=torch.repeat_interleave(torch.tensor(transmissions), torch.tensor(counts)),
        )

    def hash(self) -> str:
        """SHA-256 over geometry, materials and flags, without names and BRDFs; the same on every machine.

        Computed normals are left out: they follow from the rest, up to the last bit of a machine.
        """
        return scene_digest(self.meshes, self.materials)


def builtin_scene(name: str, *, subdivisions: int | None = None, size: float | None = None) -> Scene:
    """A scene that needs no file; its winding is taken as it is (rooms face inward).

    Args:
        name: one of `BUILTIN_SCENES`.
        subdivisions: fineness; each step has about four times the triangles. None is the scene's default.
        size: extent of "wall_and_floor" [scene units].

    Raises:
        InputError: an unknown name, or a fineness out of range.
    """
    meshes, materials = builtin_meshes(name, subdivisions=subdivisions, size=size)
    report = DefectReport()
    for index, mesh in enumerate(meshes):
        *_, found = check_mesh(*_arrays(mesh), name=mesh.name, winding="keep")
        report = found if index == 0 else report + found
    return Scene(meshes=meshes, materials=materials, name=name, defects=report)


def load_scene(spec: str | Path | Scene) -> Scene:
    """A scene from what a user typed: a path, "builtin:NAME", or a scene as it is."""
    return spec if isinstance(spec, Scene) else Scene.load(spec)


def _bounds(meshes: tuple[Mesh, ...] | list[Mesh]) -> torch.Tensor:
    positions = torch.cat([mesh.positions for mesh in meshes])
    return torch.stack([positions.amin(dim=0), positions.amax(dim=0)])


def _arrays(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return mesh.positions.numpy(), mesh.faces.numpy(), mesh.normals.numpy()


def _plain(values: object) -> np.ndarray | None:
    if isinstance(values, torch.Tensor):
        values = values.detach().cpu().numpy()
    return None if values is None else np.asarray(values)
