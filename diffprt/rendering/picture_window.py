"""The window of a light that errs least in the picture.

A light of the asset's order leaves out bands that shadows answer to. Without a window what is left rings, but has the
least error of all lights of that order, as long as the asset's own bands hold most of what it does with light: then
"none" is best, and negative radiance is clipped. Inside a box that the sun does not reach they do not: there
all that is seen is the ringing, and a window wins. Which it is follows from the bands beyond the asset's, and
those are guessed: how a pixel answers to light is non-negative in every direction, and of a diffuse surface no more
than where nothing is in the way; so its answer is made so, its known bands are put back, and again (Papoulis 1975,
Gerchberg 1974: extrapolation by alternating projections).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.rendering.picture_rows import LUMINANCE, most_answered, picture_rows
from diffprt.representation.interface import Representation
from diffprt.scene.camera import Camera
from diffprt.scene.environment import Environment
from diffprt.scene.light import Light

# Those that are compared; where two are as good, the first.
CHOICES = ("none", "lanczos", "hann")
# Bands of a light against which windows are measured.
FULL_ORDER = 10
_ROWS, _ROUNDS = 24, 16


@dataclass(frozen=True)
class PictureWindow:
    """What decides on a window.

    Attributes:
        rows: float64 [S, 100], how pixels answer to a light of order 10: by the asset, then as extrapolated.
        order: of the asset.
    """

    rows: torch.Tensor
    order: int

    @staticmethod
    def of(asset: Representation, camera: Camera) -> PictureWindow:
        """From the asset as `camera` sees it.

        Raises:
            InputError: the asset cannot be drawn.
        """
        found = picture_rows(asset.to(torch.float32), camera)
        most = most_answered(found.part, found.seen, _sphere()[0])
        return PictureWindow(extended(found.rows, FULL_ORDER, most), sh.order_of_count(found.rows.shape[1]))

    def errors(self, coefficients: torch.Tensor) -> dict[str, float]:
        """The relative RMS error expected of each window's picture under a light of order 10, [100, 3]."""
        light = coefficients.detach().double() @ torch.tensor(LUMINANCE, dtype=torch.float64)
        known = self.order**2
        full = (self.rows @ light).clamp_min(0)
        bands, size = sh.band_of_index(self.order), max(float(full.square().mean()) if len(full) else 0.0, 1e-300)
        found = {}
        for name in CHOICES:
            shown = (self.rows[:, :known] @ (sh.window(name, self.order)[bands] * light[:known])).clamp_min(0)
            found[name] = math.sqrt(float((shown - full).square().mean()) / size) if len(full) else 0.0
        return found

    def project(self, environment: Environment, turn: torch.Tensor | None = None) -> Light:
        """The map, turned by a rotation [3, 3], at the asset's order through the window of the least expected error.

        `expected_errors` in the report has them all. Gradients reach the image.
        """
        full = Light(sh.project_map(environment.image.detach(), FULL_ORDER))
        errors = self.errors((full if turn is None else full.rotate(turn)).coefficients)
        light = environment.project(self.order, window=min(errors, key=errors.__getitem__))
        light = Light(light.coefficients, light.report | {"expected_errors": errors})
        return light if turn is None else light.rotate(turn)


def extended(rows: torch.Tensor, order: int, most: torch.Tensor | None = None) -> torch.Tensor:
    """Functions on the sphere, float64 [S, K], with bands up to `order` that make them nearly non-negative, and no more
    than `most` [S, D] in the directions of a grid.

    The bands given are kept.
    """
    known = rows.shape[1]
    directions, weight = _sphere()
    basis = sh.basis(directions, order)
    back = basis * weight[:, None]
    full = torch.nn.functional.pad(rows, (0, order**2 - known))
    for _ in range(_ROUNDS):
        values = (full @ basis.T).clamp_min(0)
        full = (values if most is None else values.minimum(most)) @ back
        full[:, :known] = rows
    return full


def _sphere() -> tuple[torch.Tensor, torch.Tensor]:
    """Directions float64 [D, 3] on a grid, and their solid angles [D]."""
    edges = torch.linspace(0, math.pi, _ROWS + 1, dtype=torch.float64)
    polar, turn = (edges[:-1] + edges[1:]) / 2, (torch.arange(2 * _ROWS, dtype=torch.float64) + 0.5) * (math.pi / _ROWS)
    polar, turn = (grid.reshape(-1) for grid in torch.meshgrid(polar, turn, indexing="ij"))
    directions = torch.stack([polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()], dim=1)
    strips = (edges[:-1].cos() - edges[1:].cos()) * (math.pi / _ROWS)
    return directions, strips.repeat_interleave(2 * _ROWS)
