"""What a picture shows of distant light: how some of its pixels answer to it."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.representation.interface import Representation
from diffprt.representation.view import Samples
from diffprt.scene.camera import Camera

# Pixels a side of the view that is sampled, and samples taken of it.
_SIDE, SAMPLES = 64, 64
LUMINANCE = (0.2126, 0.7152, 0.0722)


def picture_rows(asset: Representation, camera: Camera, *, samples: int = SAMPLES) -> torch.Tensor:
    """The luminance of pixels under white light in each harmonic, float64 [S, K], S <= `samples`.

    The pixels lie evenly among those that `camera` sees anything at.

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
        return torch.zeros(0, asset.order**2, dtype=torch.float64)
    taken = torch.linspace(0, len(view.index) - 1, count, dtype=torch.float64).round().long()
    used, index = view.index[taken].unique(return_inverse=True)
    seen = Samples(index, view.weight[taken], view.points[taken], view.normals[taken])
    part, eye = asset.picked(used), torch.tensor(camera.eye, dtype=torch.float64)
    weight = torch.tensor(LUMINANCE, dtype=torch.float64)
    rows = []
    for white in torch.eye(asset.order**2)[:, :, None].expand(-1, -1, 3):
        lit = part.lit(white.contiguous())
        rows.append(lit.towards(seen, eye).detach().double() @ weight)
    return torch.stack(rows, dim=1)
