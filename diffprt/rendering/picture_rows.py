"""What a picture shows of distant light: how some of its pixels answer to it, and how much they can at most."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import singledispatch

import torch

from diffprt.representation.interface import Representation
from diffprt.representation.view import Samples
from diffprt.scene.camera import Camera
from diffprt.transfer.at_receivers import DiffuseTransfer

# Pixels a side of the view that is sampled, and samples taken of it.
_SIDE, SAMPLES = 64, 64
LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class PictureRows:
    """Some pixels of a view.

    Attributes:
        rows: float64 [S, K], their luminance under white light in each harmonic.
        part: the elements that they see.
        seen: where, [S].
    """

    rows: torch.Tensor
    part: Representation
    seen: Samples


def picture_rows(asset: Representation, camera: Camera, *, samples: int = SAMPLES) -> PictureRows:
    """Of at most `samples` pixels, evenly among those that `camera` sees anything at.

    Raises:
        InputError: the asset cannot be drawn, or answers to no distant light.
    """
    if asset.order is None:
        asset.refuse("answers to no distant light", "light it with the lights that it names")
    shrink = _SIDE / max(camera.width, camera.height)
    sides = {name: max(1, round(getattr(camera, name) * shrink)) for name in ("width", "height")}
    view = asset.elements.view(replace(camera, **sides))
    count = min(samples, len(view.index))
    if count == 0:
        nothing = Samples(view.index, view.weight, view.points, view.normals)
        return PictureRows(torch.zeros(0, asset.order**2, dtype=torch.float64), asset, nothing)
    taken = torch.linspace(0, len(view.index) - 1, count, dtype=torch.float64).round().long()
    used, index = view.index[taken].unique(return_inverse=True)
    seen = Samples(index, view.weight[taken], view.points[taken], view.normals[taken])
    part, eye = asset.picked(used), torch.tensor(camera.eye, dtype=torch.float64)
    weight = torch.tensor(LUMINANCE, dtype=torch.float64)
    rows = []
    for white in torch.eye(asset.order**2)[:, :, None].expand(-1, -1, 3):
        lit = part.lit(white.contiguous())
        rows.append(lit.towards(seen, eye).detach().double() @ weight)
    return PictureRows(torch.stack(rows, dim=1), part, seen)


@singledispatch
def most_answered(part: Representation, seen: Samples, directions: torch.Tensor) -> torch.Tensor | None:
    """The most luminance that unit light from each direction [D, 3] may cause at samples, float64 [S, D]; None where
    the kind knows none. A kind registers its own."""
    return None


@most_answered.register
def _(part: DiffuseTransfer, seen: Samples, directions: torch.Tensor) -> torch.Tensor:
    """Albedo over pi times the cosine, as if nothing were in the way; what other surfaces reflect is left out."""
    albedo = seen.mixed(part.receivers.albedo.detach()).double() @ torch.tensor(LUMINANCE, dtype=torch.float64)
    normals = torch.nn.functional.normalize(seen.normals.double(), dim=1)
    return albedo[:, None] / math.pi * (normals @ directions.T).clamp_min(0)
