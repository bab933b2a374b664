"""Exit radiance in the form that varies least over a surface: by mirrored direction, on the scene's axes.

A glossy surface shows the light around the mirror image r = 2 (n·v) n - v of the view v. Between two vertices whose
normals differ by an angle, exit radiance as a function of v turns by twice that angle, and linear interpolation blurs
it, of whole radiance towards the eye and of its coefficients alike. As a function of r it hardly turns at all: without
shadows, the exit radiance of a lobe about r is the light convolved with the lobe, the same at every vertex. So
coefficients by r are what is interpolated, and each pixel finds r with its own normal. At the vertices themselves the
result is exact. The Lambertian part does not depend on direction and is interpolated as ever.

Source: Sloan, Kautz and Snyder, "Precomputed Radiance Transfer for Real-Time Rendering" (SIGGRAPH 2002), which looks
glossy radiance up at the mirrored direction; here that direction only chooses what is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.representation.lit import Basis
from diffprt.representation.view import Samples
from diffprt.sh.frames import frame_rotations, rows_from_frames

_RECEIVERS_AT_ONCE = 8192


def mirrored(radiance: torch.Tensor, frames: torch.Tensor) -> torch.Tensor:
    """Exit radiance by mirrored direction, in SH on the scene's axes.

    Args:
        radiance: float [V, 3 B, K_out], under B lights, by direction, on each receiver's own axes.
        frames: [V, 3, 3], columns tangent, bitangent, normal.

    Returns:
        [V, 3 B, K_out] in the dtype of `radiance`; gradients reach it.
    """
    # The mirrored direction is the view turned by half a circle about the normal, (-x, -y, z) on the receiver's axes.
    order = sh.order_of_count(radiance.shape[-1])
    turned = radiance * _half_turn(order).to(radiance)
    parts = []
    for axes, rows in zip(frames.split(_RECEIVERS_AT_ONCE), turned.split(_RECEIVERS_AT_ONCE), strict=True):
        parts.append(rows_from_frames(rows, frame_rotations(axes.to(rows.dtype), order)))
    return torch.cat(parts)


@dataclass(frozen=True)
class MirroredBasis(Basis):
    """SH of `order` at the mirrored direction of each point."""

    order: int
    needs_eye = True

    def at(self, samples: Samples, eye: torch.Tensor | None) -> torch.Tensor:
        """[N, K_out]. Points that face away have the values along their horizon. Gradients reach points, normals and
        eye.

        Raises:
            InputError: there is no eye.
        """
        if eye is None:
            raise InputError("a glossy asset looks different from everywhere: give view, such as camera.eye")
        view = torch.nn.functional.normalize(eye.to(samples.points) - samples.points, dim=-1)
        normals = torch.nn.functional.normalize(samples.normals, dim=-1)
        below = (view * normals).sum(-1, keepdim=True).clamp_max(0)
        view = torch.nn.functional.normalize(view - below * normals, dim=-1)
        return sh.basis(2 * (view * normals).sum(-1, keepdim=True) * normals - view, self.order)


def _half_turn(order: int) -> torch.Tensor:
    """(-1)^m of each coefficient, [K]: what a half turn about z multiplies it by."""
    return torch.tensor([(-1.0) ** abs(m) for l in range(order) for m in range(-l, l + 1)])


def above_horizon(directions: torch.Tensor) -> torch.Tensor:
    """Directions [..., 3] on local axes, those below the surface moved up to its horizon.

    Interpolated normals lean away from their triangles, so a surface is seen from slightly below its own horizon.
    """
    lifted = torch.cat([directions[..., :2], directions[..., 2:].clamp_min(0)], dim=-1)
    return torch.nn.functional.normalize(lifted, dim=-1)
