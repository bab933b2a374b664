"""Every kind of asset, and two that diffprt does not know, small enough to try all laws on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import ClassVar

import torch
from face_colors import FaceColors, Faces

from diffprt import Light, Receivers, bake, bake_glossy, compress
from diffprt.brdf import ModifiedPhong
from diffprt.representation import (
    FLOATS,
    Basis,
    Lighting,
    LightingLike,
    Lit,
    PointLight,
    Provenance,
    Representation,
    Samples,
    TensorSpec,
)
from diffprt.scene import Scene, builtin_scene

ORDER = 3


@dataclass(frozen=True)
class NormalBasis(Basis):
    """x, y and z of the pixel's normal: irradiance of a vector E is n · E."""

    def at(self, samples: Samples, eye: torch.Tensor | None) -> torch.Tensor:
        return torch.nn.functional.normalize(samples.normals, dim=1)


@dataclass(frozen=True)
class IrradianceVectors(Representation):
    """Light that was solved for, as vectors [E, 3 axes, 3 colors] for two groups of lamps; others may be added."""

    name, description, elements_type = "irradiance_vectors", "vector irradiance over pi of groups of lamps", Receivers
    spec: ClassVar = {"vectors": TensorSpec(("V", "groups", 3, 3), FLOATS, per_element=True, trainable=True)}
    groups: ClassVar = ("ceiling", "window")
    vectors: torch.Tensor
    elements: Receivers
    provenance: Provenance = field(default_factory=Provenance, compare=False)

    def check_albedo(self) -> None:
        pass

    def lit(self, lighting: LightingLike, *, albedo: torch.Tensor | None = None) -> Lit:
        light = Lighting.of(lighting).needs("groups", "local", of="IrradianceVectors")
        total = torch.zeros_like(self.vectors[:, 0])
        for index, name in enumerate(self.groups):
            total = total + self.vectors[:, index] * torch.as_tensor(light.groups.get(name, 0.0), dtype=total.dtype)
        for lamp in light.local:
            away = lamp.position.to(total) - self.elements.positions.to(total)
            falloff = away / away.norm(dim=1, keepdim=True) ** 3 / math.pi
            total = total + falloff[:, :, None] * lamp.intensity.to(total)
        albedo = self.elements.albedo if albedo is None else albedo
        return Lit(albedo.to(total)[:, :, None] * total.transpose(1, 2), NormalBasis())


@cache
def ball() -> Scene:
    """A dented ball of 162 vertices: smooth normals, some shadow, and a color of its own."""
    mesh = builtin_scene("sphere", subdivisions=2).meshes[0]
    p = mesh.positions.double()
    scale = 1 + 0.2 * (4 * p[:, :1]).sin() * (5 * p[:, 1:2]).sin()
    return Scene.from_mesh((p * scale).float(), mesh.faces, albedo=(0.7, 0.5, 0.3), name="dented ball")


@cache
def transfer():
    return bake(ball(), order=ORDER, rays=32, bounces=1)


@cache
def glossy():
    return bake_glossy(ball(), ModifiedPhong(8.0, diffuse=0.2, specular=0.7), order=ORDER, rays=32, bounces=0)


@cache
def face_colors() -> FaceColors:
    mesh = ball().meshes[0]
    colors = torch.rand(len(mesh.faces), 3, generator=torch.Generator().manual_seed(0)) + 0.1
    return FaceColors(colors, Faces(mesh.positions[mesh.faces]), Provenance({"made": "by hand"}))


@cache
def irradiance_vectors() -> IrradianceVectors:
    receivers = transfer().receivers
    noise = torch.rand(len(receivers), 2, 3, 3, generator=torch.Generator().manual_seed(1))
    return IrradianceVectors(noise + receivers.normals[:, None, :, None], receivers)


@dataclass(frozen=True)
class Case:
    """A kind of asset and two lights that it answers to, which may be added and scaled.

    Attributes:
        make: the asset.
        lights: from a number, lights that are linear in it.
        drawn: whether it has a packer, so that pages draw it.
    """

    make: Callable[[], Representation]
    lights: Callable[[float, float], LightingLike]
    drawn: bool = True


def distant(order: int) -> Callable[[float, float], LightingLike]:
    generator = torch.Generator().manual_seed(order)
    one, two = (torch.randn(order**2, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    one[0], two[0] = torch.tensor([4.0, 3.5, 3.0]).double(), torch.tensor([3.0, 3.5, 4.0]).double()
    return lambda a, b: Light(a * one + b * two)


def lamps(a: float, b: float) -> Lighting:
    spot = PointLight(torch.tensor([0.0, 2.0, 1.0]), b * torch.tensor([3.0, 2.0, 1.0]).double())
    return Lighting(groups={"ceiling": a, "window": b * torch.tensor([1.0, 0.5, 0.2]).double()}, local=(spot,))


REPRESENTATIONS = {
    "transfer": Case(transfer, distant(ORDER)),
    "clustered_transfer": Case(lambda: compress(transfer(), clusters=6, components=3), distant(ORDER)),
    "glossy_transfer": Case(glossy, distant(ORDER)),
    "clustered_glossy_transfer": Case(lambda: compress(glossy(), clusters=5, components=3), distant(ORDER)),
    "face_colors": Case(face_colors, distant(1)),
    "irradiance_vectors": Case(irradiance_vectors, lamps, drawn=False),
}
