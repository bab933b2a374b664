"""What a file reader hands over: plain arrays, before any check or repair."""

from __future__ import annotations

import io
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from PIL import Image

from diffprt.errors import InputError
from diffprt.scene.material import Material
from diffprt.scene.srgb import linear_from_srgb

DEFAULT_ALBEDO = 0.8

_TO_Y_UP = {
    "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}


@dataclass(frozen=True)
class Part:
    """One mesh as read: positions [V, 3], faces [F, 3], normals, uv (v down) and linear colors or None."""

    positions: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None
    colors: np.ndarray | None = None
    material: int = 0
    name: str = "mesh"

    def checked(self) -> Part:
        """The part, if its arrays belong together; without faces, [0, 3] in place of whatever shape they have.

        Raises:
            InputError: an array has another shape, or holds no numbers.
        """
        count = len(self.positions)
        faces = np.asarray(self.faces)
        faces = np.zeros((0, 3), dtype=np.int64) if faces.size == 0 else faces
        wanted = {"positions": (count, 3), "normals": (count, 3), "uv": (count, 2), "colors": (count, 3)}
        arrays = {name: getattr(self, name) for name in wanted} | {"faces": faces}
        for name, values in arrays.items():
            if values is None:
                continue
            array, shape = np.asarray(values), wanted.get(name, (len(faces), 3))
            if array.shape != shape:
                raise InputError(f"'{self.name}' has {name} of shape {array.shape}, wanted {shape}")
            if array.dtype.kind not in ("iu" if name == "faces" else "fiu"):
                raise InputError(f"'{self.name}' has {name} of type {array.dtype}, wanted numbers")
        return replace(self, faces=faces)

    def placed(self, matrix: np.ndarray) -> Part:
        """The part under an affine `matrix` [4, 4] on column vectors; a mirror turns the faces over."""
        linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
        determinant = np.linalg.det(linear)
        if np.array_equal(matrix, np.eye(4)):
            return self
        normals = self.normals
        if normals is not None and determinant != 0:
            normals = np.asarray(normals, dtype=np.float64) @ np.linalg.inv(linear)
        positions = np.asarray(self.positions, dtype=np.float64) @ linear.T + np.asarray(matrix)[:3, 3]
        faces = self.faces[:, [0, 2, 1]] if determinant < 0 else self.faces
        return replace(self, positions=positions, normals=normals, faces=faces)


@dataclass
class Parts:
    """All that a file holds: its parts, their materials, remarks, and the axis that points up."""

    parts: list[Part] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    up: str = "y"

    def material(self, material: Material) -> int:
        """Adds a material and returns its index."""
        self.materials.append(material)
        return len(self.materials) - 1

    def default_material(self, colored: bool) -> int:
        """A material for parts that name none: white under vertex colours, else grey."""
        albedo = 1.0 if colored else DEFAULT_ALBEDO
        for index, material in enumerate(self.materials):
            if material.name == "default" and float(material.albedo[0]) == np.float32(albedo):
                return index
        return self.material(Material(albedo, name="default"))

    def turned_up(self, up: str | None) -> Parts:
        """The parts turned so that the axis `up` of the file (None: the format's own) becomes +y."""
        up = self.up if up is None else up
        if up not in _TO_Y_UP:
            raise InputError(f"up axis is '{up}': give one of {', '.join(_TO_Y_UP)}")
        matrix = np.eye(4)
        matrix[:3, :3] = _TO_Y_UP[up]
        return replace(self, parts=[part.placed(matrix) for part in self.parts], up="y")

    def recentered(self) -> Parts:
        """The parts moved, in 64-bit coordinates, so that the box around them has its center at the origin."""
        points = np.concatenate([np.asarray(part.positions, dtype=np.float64).reshape(-1, 3) for part in self.parts])
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) == 0:
            return self
        matrix = np.eye(4)
        matrix[:3, 3] = -(points.min(axis=0) + points.max(axis=0)) / 2
        note = f"moved by ({', '.join(f'{x:.9g}' for x in matrix[:3, 3])}) to the origin, as asked"
        return replace(self, parts=[part.placed(matrix) for part in self.parts], notes=[*self.notes, note])


def texture_from_bytes(data: bytes) -> torch.Tensor:
    """Linear RGB texture [H, W, 3] from the bytes of a PNG or JPEG file (sRGB)."""
    return texture_from_picture(Image.open(io.BytesIO(data)))


def texture_from_picture(picture: Image.Image) -> torch.Tensor:
    """Linear RGB texture [H, W, 3] from a decoded sRGB picture; alpha is left out."""
    pixels = np.asarray(picture.convert("RGB"), dtype=np.float32) / 255
    return linear_from_srgb(torch.from_numpy(pixels))


def linear_colors(colors: np.ndarray) -> np.ndarray:
    """Linear RGB [N, 3] from sRGB vertex colours: integers over their range, or numbers in [0, 1]."""
    colors = np.asarray(colors)[:, :3]
    if np.issubdtype(colors.dtype, np.integer):
        colors = colors / np.iinfo(colors.dtype).max
    return linear_from_srgb(torch.from_numpy(np.asarray(colors, dtype=np.float32))).numpy()
