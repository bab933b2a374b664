"""What a pixel can see of an asset: receivers of a mesh, face clusters, surfels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import torch

from diffprt.representation.moving import moved
from diffprt.representation.spec import FLOATS, Spec
from diffprt.representation.view import View
from diffprt.scene.camera import Camera
from diffprt.scene.subject import is_ground


class Elements(ABC):
    """E things that carry an asset's coefficients; a frozen dataclass whose fields are the tensors of `spec`.

    Attributes:
        spec: their tensors, as they stand in files beside those of the representation.
        positions: float [E, 3], where each is, scene units.
        normals: float [E, 3], unit.
    """

    __dataclass_fields__: ClassVar[dict]
    spec: ClassVar[Spec]
    positions: torch.Tensor
    normals: torch.Tensor

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def view(self, camera: Camera, *, threads: int | None = None) -> View:
        """What `camera` sees of them, one sample per pixel center; frozen: no gradient reaches camera or positions.

        Raises:
            InputError: they cannot be drawn.
        """

    @property
    def subject(self) -> torch.Tensor:
        """Positions [S, 3] of what pictures are of: all but a ground. `Camera.framing` takes them."""
        return self.positions[~is_ground(self.positions, self.normals)]

    @abstractmethod
    def picked(self, rows: torch.Tensor) -> Self:
        """The elements `rows`, int64 [S], alone: they can be lit, not drawn. Gradients pass through."""

    @classmethod
    def restored(cls, tensors: dict[str, torch.Tensor]) -> Self:
        """The elements of a file's tensors; raises InputError where they do not belong together."""
        return cls(**tensors)

    def to(self, target: torch.device | torch.dtype | str) -> Self:
        """On another device; a dtype changes those tensors alone whose spec admits it."""
        return moved(self, target, frozenset(name for name, tensor in self.spec.items() if tensor.dtypes != FLOATS))
