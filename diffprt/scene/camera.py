"""A pinhole camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from diffprt.errors import InputError
from diffprt.options.numbers import check_numbers


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in scene space (+y up, right-handed); it looks from `eye` to `target`.

    Attributes:
        eye, target, up: 3-tuples, scene units.
        fov: vertical field of view [degrees], in (0, 180).
        width, height: image size [pixels].
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 35.0
    width: int = 512
    height: int = 512

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            _checked(name, getattr(self, name))
        if not 0.0 < self.fov < 180.0:
            raise InputError(f"camera has a field of view of {self.fov} degrees: give one between 0 and 180")
        if not (1 <= self.width <= 16384 and 1 <= self.height <= 16384):
            raise InputError(f"camera has size {self.width} x {self.height}: give 1 to 16384 pixels a side")
        if math.dist(self.eye, self.target) == 0.0:
            raise InputError(f"camera eye and target are both {self.eye}: move one of them")

    @staticmethod
    def framing(
        positions: torch.Tensor,
        *,
        azimuth: float = 25.0,
        elevation: float = 15.0,
        fov: float = 35.0,
        width: int = 512,
        height: int = 512,
        margin: float = 1.05,
        target: tuple[float, float, float] | None = None,
        distance: float | None = None,
    ) -> Camera:
        """A camera that sees all of `positions` [V, 3].

        Args:
            azimuth: degrees around +y, 0 looks from +z, 90 from +x.
            elevation: degrees above the horizon.
            margin: 1 touches the frame.
            target: what it looks at, scene units; without it, the center of the positions' box.
            distance: from the target, scene units; without it, the least from which all are seen.

        Raises:
            InputError: an angle, a distance or a size is out of range.
        """
        check_numbers({"azimuth": azimuth, "elevation": elevation, "fov": fov, "distance": distance})
        points = positions.detach().double()
        center = (points.amin(0) + points.amax(0)) / 2
        if target is not None:
            center = torch.tensor(_checked("target", target), dtype=torch.float64)
        a, e = math.radians(azimuth), math.radians(elevation)
        back = torch.tensor([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)], dtype=torch.float64)
        eye = tuple((center + back).tolist())
        view = replace(Camera(eye, tuple(center.tolist()), fov=fov, width=width, height=height)).view()[:3, :3]
        local = (points - center) @ view.T
        tangent = math.tan(math.radians(fov) / 2)
        slope = torch.tensor([tangent * width / height, tangent], dtype=torch.float64)
        if distance is None:
            distance = float((local[:, :2].abs() / slope * margin + local[:, 2:]).max())
            scale = float((points.amax(0) - points.amin(0)).norm())
            distance = max(distance, 1e-3 * scale, 1e-12)
        return Camera(
            tuple((center + back * distance).tolist()),
            tuple(center.tolist()),
            fov=fov,
            width=width,
            height=height,
        )

    def view(self) -> torch.Tensor:
        """World to eye, float64 [4, 4]; the eye looks along -z."""
        eye = torch.tensor(self.eye, dtype=torch.float64)
        back = torch.nn.functional.normalize(eye - torch.tensor(self.target, dtype=torch.float64), dim=0)
        right = torch.linalg.cross(torch.tensor(self.up, dtype=torch.float64), back)
        if float(right.norm()) < 1e-9:
            raise InputError(f"camera looks along its up vector {self.up}: choose another up")
        right = torch.nn.functional.normalize(right, dim=0)
        up = torch.linalg.cross(back, right)
        matrix = torch.eye(4, dtype=torch.float64)
        matrix[:3, :3] = torch.stack([right, up, back])
        matrix[:3, 3] = -matrix[:3, :3] @ eye
        return matrix

    def projection(self, near: float, far: float) -> torch.Tensor:
        """Eye to clip (OpenGL, z in [-w, w]), float64 [4, 4]."""
        f = 1.0 / math.tan(math.radians(self.fov) / 2)
        matrix = torch.zeros((4, 4), dtype=torch.float64)
        matrix[0, 0] = f * self.height / self.width
        matrix[1, 1] = f
        matrix[2, 2] = (far + near) / (near - far)
        matrix[2, 3] = 2 * far * near / (near - far)
        matrix[3, 2] = -1.0
        return matrix

    def depth_range(self, positions: torch.Tensor) -> tuple[float, float]:
        """Near and far distance [scene units] that hold `positions` [V, 3]."""
        depth = -(positions.detach().double() @ self.view()[2, :3] + self.view()[2, 3])
        far = max(float(depth.max()), 1e-6) * 1.01
        return max(float(depth.min()) * 0.99, far * 1e-4), far


def _checked(name: str, values: tuple[float, ...]) -> tuple[float, ...]:
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise InputError(f"camera has {name} {tuple(values)}: give three finite numbers")
    return values
