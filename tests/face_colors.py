"""A kind of asset that diffprt does not know, whole: one color for each face of a mesh, under uniform light."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import torch

from diffprt.exporters.packers.packed import Packed, floats
from diffprt.exporters.packers.registry import pack
from diffprt.representation import ConstantBasis, Elements, Lighting, Lit, Provenance, Representation, TensorSpec, View
from diffprt.surface import triangles_in_view

_CONSTANT = 1 / math.sqrt(4 * math.pi)


@dataclass(frozen=True)
class Faces(Elements):
    spec: ClassVar = {"corners": TensorSpec(("E", 3, 3), ("float32",), per_element=True)}
    corners: torch.Tensor

    def __len__(self):
        return len(self.corners)

    @property
    def positions(self):
        return self.corners.mean(1)

    @property
    def normals(self):
        a, b, c = self.corners.unbind(1)
        return torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)

    def view(self, camera, *, threads=None):
        indices = torch.arange(3 * len(self)).view(-1, 3)
        corners, weights, mask, depth = triangles_in_view(self.corners.flatten(0, 1), indices, camera, threads=threads)
        return View(self.positions, self.normals, corners[:, :1] // 3, weights.sum(1, keepdim=True), mask, depth)

    def picked(self, rows):
        return Faces(self.corners[rows])


@dataclass(frozen=True)
class FaceColors(Representation):
    name, description, elements_type = "face_colors", "color of each face under light of radiance 1", Faces
    spec: ClassVar = {"colors": TensorSpec(("E", 3), per_element=True, trainable=True)}
    order = 1
    colors: torch.Tensor
    elements: Faces
    provenance: Provenance = field(default_factory=Provenance, compare=False)

    def lit(self, lighting, *, albedo=None):
        if albedo is not None:
            self.check_albedo()
        light = Lighting.of(lighting).coefficients(1, type(self).__name__).to(self.colors)
        return Lit((self.colors * light * _CONSTANT)[..., None], ConstantBasis())


@pack.register
def pack_face_colors(asset: FaceColors) -> Packed:
    geometry = {
        "positions": floats(asset.elements.corners.flatten(0, 1)),
        "albedo": np.ones((1, 3), np.float32),
        "indices": np.arange(3 * len(asset.colors), dtype=np.uint32).reshape(-1, 3),
        "normals": floats(asset.elements.normals.repeat_interleave(3, 0)),
    }
    transfer = floats(math.pi * _CONSTANT * asset.colors.repeat_interleave(3, 0)[..., None])
    numbers, facts = {"channels": 3, "coefficients": 1}, {"order": 1}
    form = {"kind": "face_colors", "page": "diffuse", "programs": ("diffuse",)}
    return Packed(**form, geometry=geometry, signal={"transfer": transfer}, numbers=numbers, facts=facts)
