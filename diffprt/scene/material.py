"""Materials: what a surface does with the light that arrives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from diffprt.brdf import Brdf
from diffprt.errors import InputError


@dataclass(frozen=True)
class Material:
    """Reflectance of a surface, linear RGB.

    Attributes:
        albedo: float32 [3] in [0, 1]; also accepts a number or three numbers.
        albedo_texture: float32 [H, W, 3] linear in [0, 1], times `albedo`; None for a constant material.
        brdf: how the surface reflects, in place of `albedo`; None is Lambertian with the albedo. A scene is glossy
            where a material has one, and scene hashes leave it out: assets record BRDFs in their settings.
        name: for messages.
        transmission: in [0, 1], the share of what is reflected that leaves on the other side of the surface instead: a
            thin translucent sheet, such as a leaf or paper. Both sides together send out `albedo` of what arrives.

    Gradients reach `albedo` and `albedo_texture` through `sample`, and the BRDF's parameters; `transmission` has none.

    Raises:
        InputError: an albedo or transmission outside [0, 1] or not a number, what is no BRDF, a texture of another
            shape.
    """

    albedo: torch.Tensor
    albedo_texture: torch.Tensor | None = None
    brdf: Brdf | None = None
    name: str = ""
    transmission: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.brdf, Brdf | None):
            raise InputError(
                f"material '{self.name}' has BRDF {self.brdf!r}: give a diffprt.brdf.Brdf, such as GGX(0.3), or None "
                "for lambert with the albedo"
            )
        albedo = torch.as_tensor(self.albedo, dtype=torch.float32)
        if albedo.ndim == 0:
            albedo = albedo.expand(3)
        if tuple(albedo.shape) != (3,):
            raise InputError(f"material '{self.name}' has albedo of shape {tuple(albedo.shape)}: give three numbers")
        object.__setattr__(self, "albedo", albedo)
        _check_range(albedo, f"material '{self.name}' has albedo {[round(x, 6) for x in albedo.tolist()]}")
        transmission = float(self.transmission)
        if not 0 <= transmission <= 1:
            raise InputError(
                f"material '{self.name}' has transmission {transmission:g}: give the share of what is reflected that "
                "goes through, in [0, 1]"
            )
        object.__setattr__(self, "transmission", transmission)
        texture = self.albedo_texture
        if texture is not None:
            if texture.ndim != 3 or texture.shape[2] != 3 or texture.numel() == 0:
                raise InputError(
                    f"material '{self.name}' has a texture of shape {tuple(texture.shape)}: give [H, W, 3]"
                )
            low, high = float(texture.detach().min()), float(texture.detach().max())
            _check_range(texture, f"material '{self.name}' has a texture from {low:.4g} to {high:.4g}")

    def with_albedo(self, albedo: torch.Tensor | float | tuple) -> Material:
        """The same BRDF with a constant albedo."""
        return replace(self, albedo=albedo, albedo_texture=None)

    def sample(self, uv: torch.Tensor) -> torch.Tensor:
        """Albedo [N, 3] at texture coordinates `uv` [N, 2]: bilinear, repeating, v = 0 at the top row."""
        if self.albedo_texture is None:
            return self.albedo.expand(len(uv), 3)
        texture = self.albedo_texture
        height, width, _ = texture.shape
        x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
        left, top = x.floor(), y.floor()
        right_weight, bottom_weight = (x - left)[:, None], (y - top)[:, None]
        left, right = left.long() % width, (left.long() + 1) % width
        top, bottom = top.long() % height, (top.long() + 1) % height
        upper = texture[top, left] * (1 - right_weight) + texture[top, right] * right_weight
        lower = texture[bottom, left] * (1 - right_weight) + texture[bottom, right] * right_weight
        return self.albedo * (upper * (1 - bottom_weight) + lower * bottom_weight)


def _check_range(values: torch.Tensor, found: str) -> None:
    """Refuses what would create energy; a NaN fails too."""
    detached = values.detach()
    if not bool(((detached >= 0) & (detached <= 1)).all()):
        raise InputError(f"{found}: reflectance lies in [0, 1], linear RGB")
