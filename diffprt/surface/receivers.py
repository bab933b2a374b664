"""Receivers: the points at which transfer is computed. Mesh vertices are one way to make them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.options.ranges import check_geometry
from diffprt.representation.elements import Elements
from diffprt.representation.spec import Spec, TensorSpec
from diffprt.representation.view import View
from diffprt.scene.camera import Camera
from diffprt.surface.few_bits import BOX, FEW_BITS, from_few_bits, to_few_bits
from diffprt.surface.raster import triangles_in_view

_SCRAMBLE_CELLS = 1 << 20
_CURVE_BITS = 16


@dataclass(frozen=True)
class Receivers(Elements):
    """Points with a normal and an albedo, and the triangles (if any) that connect them for display.

    Attributes:
        positions: float32 [V, 3], scene units, +y up.
        normals: float32 [V, 3], unit.
        albedo: float32 [V, 3], linear reflectance in [0, 1]; sampled from textures where there are some.
        faces: int64 [F, 3] into the receivers; [0, 3] when the receivers are not a surface.
        transmission: float32 [V] in [0, 1] where some surfaces are translucent (`Material.transmission`), else None.
            It plays its part in tracing and is not saved in assets.
        bits: of positions, normals and albedo in files, 32 or 16 (`diffprt.surface.few_bits`).
    """

    spec: ClassVar[Spec] = {
        "positions": TensorSpec(("V", 3), ("float32",), per_element=True),
        "normals": TensorSpec(("V", 3), ("float32",), per_element=True, least=-1, most=1),
        "albedo": TensorSpec(("V", 3), ("float32",), per_element=True, least=0, most=1),
        "faces": TensorSpec(("F", 3), ("int32",), index_of="V"),
    }

    positions: torch.Tensor
    normals: torch.Tensor
    albedo: torch.Tensor
    faces: torch.Tensor
    transmission: torch.Tensor | None = None
    bits: int = 32

    def __post_init__(self) -> None:
        count = len(self.positions)
        for name in ("positions", "normals", "albedo"):
            shape = tuple(getattr(self, name).shape)
            if shape != (count, 3):
                raise InputError(f"receivers have {name} of shape {shape}: give [{count}, 3]")
        if self.transmission is not None and tuple(self.transmission.shape) != (count,):
            raise InputError(f"receivers have transmission of shape {tuple(self.transmission.shape)}: give [{count}]")
        if self.transmission is not None and not bool(((self.transmission >= 0) & (self.transmission <= 1)).all()):
            raise InputError("receivers have a transmission outside [0, 1]: give the share that goes through")
        if count == 0:
            raise InputError("there are no receivers: the scene needs at least one mesh that is not occluder-only")
        if not bool(torch.isfinite(self.positions).all() and torch.isfinite(self.normals).all()):
            raise InputError("receivers have non-finite positions or normals: repair the mesh first")
        if len(self.faces) and not 0 <= int(self.faces.min()) <= int(self.faces.max()) < count:
            raise InputError(f"receivers have faces that name vertices outside 0..{count - 1}: repair the mesh first")

    def __len__(self) -> int:
        return len(self.positions)

    @staticmethod
    def points(
        positions: torch.Tensor,
        normals: torch.Tensor,
        albedo: torch.Tensor | float = 0.8,
        *,
        transmission: torch.Tensor | float | None = None,
    ) -> Receivers:
        """Free receivers, such as texels or probes: `positions`, `normals` [V, 3]; `albedo` a number or [V, 3];
        `transmission` a number or [V], in [0, 1]."""
        positions = torch.as_tensor(positions, dtype=torch.float32)
        normals = torch.nn.functional.normalize(torch.as_tensor(normals, dtype=torch.float32), dim=-1)
        albedo = torch.as_tensor(albedo, dtype=torch.float32).expand(len(positions), 3).contiguous()
        if transmission is not None:
            transmission = torch.as_tensor(transmission, dtype=torch.float32).expand(len(positions)).contiguous()
        return Receivers(positions, normals, albedo, torch.zeros((0, 3), dtype=torch.int64), transmission)

    @classmethod
    def file_spec(cls, names: Collection[str]) -> Spec:
        return FEW_BITS if BOX in names else cls.spec

    def stored(self) -> dict[str, torch.Tensor]:
        if self.bits == 32:
            return super().stored()
        return to_few_bits(self.positions, self.normals, self.albedo, self.faces)

    @classmethod
    def restored(cls, tensors: dict[str, torch.Tensor]) -> Receivers:
        if BOX in tensors:
            found = from_few_bits(tensors)
            return cls(found["positions"], found["normals"], found["albedo"], found["faces"], bits=16)
        own = {**tensors, "faces": tensors["faces"].to(torch.int64)}
        return cls(**own)  # pyright: ignore[reportArgumentType]

    def in_bits(self, bits: int) -> Receivers:
        """The same as they come back from a file of so many bits, 32 or 16; no gradients pass through 16."""
        check_geometry(bits)
        if bits == 32 or self.bits == 16:
            return replace(self, bits=bits)
        rounded = from_few_bits(to_few_bits(self.positions, self.normals, self.albedo, self.faces))
        return replace(self, bits=16, **rounded)

    def view(self, camera: Camera, *, threads: int | None = None) -> View:
        """The corners of the triangle at each pixel center, with perspective-correct weights."""
        seen = triangles_in_view(self.positions, self.faces, camera, threads=threads)
        return View(self.positions, self.normals, *seen)

    @property
    def sides(self) -> int:
        """How many hemispheres are traced: one for each receiver, two for translucent ones."""
        return len(self) + (0 if self.transmission is None else int(self.transmission.count_nonzero()))

    def with_albedo(self, albedo: torch.Tensor) -> Receivers:
        """The same points with `albedo` [V, 3], [V, 1] or [3], in [0, 1]; it may carry gradients."""
        if tuple(albedo.shape) not in ((len(self), 3), (len(self), 1), (3,)):
            raise InputError(f"albedo has shape {tuple(albedo.shape)}: give [{len(self)}, 3], [{len(self)}, 1] or [3]")
        if not bool(((albedo >= 0) & (albedo <= 1)).all()):
            raise InputError(
                f"albedo has values from {float(albedo.min()):.3g} to {float(albedo.max()):.3g}: give values in [0, 1]"
            )
        return replace(self, albedo=albedo.expand(len(self), 3))

    def hash(self) -> str:
        """SHA-256 of positions and normals."""
        digest = hashlib.sha256()
        for tensor in (self.positions, self.normals):
            digest.update(tensor.detach().to(torch.float32).contiguous().numpy().tobytes())
        return digest.hexdigest()

    def coincident(self) -> np.ndarray:
        """A number for each receiver, int64 [V], that those of the same position and normal (seams) share."""
        rows = torch.cat([self.positions, self.normals], dim=1).contiguous().numpy() + np.float32(0)
        _, group = np.unique(rows.view(f"V{rows.itemsize * 6}")[:, 0], return_inverse=True)
        return group.reshape(-1)

    def along_curve(self) -> torch.Tensor:
        """The receivers in the order of a Z-curve through space (Morton 1966), int64 [V].

        Rays of neighbors meet the same nodes and triangles: traced one after the other, they find them in the
        processor's caches.
        """
        low = self.positions.amin(0)
        size = float((self.positions.amax(0) - low).max()) or 1.0
        cells = ((self.positions - low) / size * ((1 << _CURVE_BITS) - 1)).long()
        code = torch.zeros(len(self), dtype=torch.int64)
        for bit in range(_CURVE_BITS):
            for axis in range(3):
                code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
        return code.argsort(stable=True)

    def reordered(self, order: torch.Tensor) -> Receivers:
        """The receivers `order`, a permutation int64 [V], with the faces that connect them."""
        place = order.argsort()
        return replace(self.picked(order), faces=place[self.faces])

    def picked(self, pick: torch.Tensor) -> Receivers:
        """Some of the receivers, int64 [S], without triangles."""
        through = None if self.transmission is None else self.transmission[pick]
        empty = torch.zeros((0, 3), dtype=torch.int64)
        return Receivers(self.positions[pick], self.normals[pick], self.albedo[pick], empty, through, self.bits)

    def origins(self, offset: float) -> torch.Tensor:
        """Where rays start, float32 [V, 3]: `offset` above the surface, and as much inwards from its border.

        A receiver on the border of its surface may lie exactly on another one (the corner of a room): moved
        inwards, towards the mean of its triangles' centroids, it is on the right side of both. Inside a
        surface the inward part vanishes. Receivers that share position and normal share their triangles here,
        so both sides of a texture seam start in the same place.
        """
        shift = self.normals.double()
        if len(self.faces):
            group = torch.from_numpy(self.coincident())
            corners = self.faces.reshape(-1)
            points = self.positions.double()
            centroids = points[self.faces].mean(1).repeat_interleave(3, dim=0)
            away = centroids - points[corners]
            size = int(group.max()) + 1
            total = torch.zeros(size, 3, dtype=torch.float64).index_add_(0, group[corners], away)
            length = torch.zeros(size, dtype=torch.float64).index_add_(0, group[corners], away.norm(dim=1))
            inward = (total / length.clamp_min(1e-300)[:, None])[group]
            shift = shift + inward - (inward * self.normals).sum(1, keepdim=True) * self.normals
        return (self.positions.double() + offset * shift).float()

    def scramble(self, seed: int, low: torch.Tensor, diagonal: float) -> torch.Tensor:
        """One 32-bit number per receiver that turns the sample pattern.

        It depends on where the receiver is in the box of the scene and on its normal, never on its index:
        seam vertices agree, and a scaled or reordered mesh keeps its patterns.

        Args:
            seed: any integer.
            low: [3], the least corner of the scene's box.
            diagonal: length of the box's diagonal, scene units.

        Returns:
            int64 [V] in [0, 2^32).
        """
        relative = (self.positions.double() - low.double()) / max(diagonal, 1e-300)
        cells = torch.cat([relative, self.normals.double()], dim=1).mul(_SCRAMBLE_CELLS).round().to(torch.int64)
        state = np.full(len(self), np.uint64(seed & 0xFFFFFFFFFFFFFFFF), dtype=np.uint64)
        for column in cells.numpy().astype(np.uint64).T:
            state = _splitmix(state ^ column)
        return torch.from_numpy((state >> np.uint64(32)).astype(np.int64))


def _splitmix(state: np.ndarray) -> np.ndarray:
    """The finalizer of SplitMix64 (Steele, Lea and Flood 2014)."""
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))
