"""Light probes: square images of the whole sphere, turned into equirectangular maps."""

from __future__ import annotations

import torch

from diffprt import sh
from diffprt.errors import InputError

PROBES = ("angular", "mirror_ball")
# Samples along each side of a texel; a probe squeezes the directions near +z together.
_SUBSAMPLES = 3


def equirect_from_probe(image: torch.Tensor, projection: str, *, name: str = "probe") -> torch.Tensor:
    """An equirectangular map [S / 2, S, 3] from a probe `image` [S, S, 3].

    The centre of the probe looks along -z, up is +y, right is +x, and its rim is +z. The distance from the
    centre, with the rim at 1, is angle / π for "angular" maps (Debevec 1998) and sin(angle / 2) for the
    photograph of a mirror ball from afar. Sampling is bilinear.

    Raises:
        InputError: the image is not square.
    """
    height, width, _ = image.shape
    if height != width:
        raise InputError(
            f"environment '{name}' is {width} x {height}, a probe is square: crop it to the ball, "
            "or pass projection='equirect'"
        )
    rows = max(height // 2, 1)
    result = torch.zeros(rows, 2 * rows, image.shape[2], dtype=image.dtype)
    fine = sh.map_directions(rows * _SUBSAMPLES, 2 * rows * _SUBSAMPLES)
    for i in range(_SUBSAMPLES):
        for j in range(_SUBSAMPLES):
            result += _sample(image, fine[i::_SUBSAMPLES, j::_SUBSAMPLES], projection)
    return result / _SUBSAMPLES**2


def _sample(image: torch.Tensor, directions: torch.Tensor, projection: str) -> torch.Tensor:
    x, y, z = directions.unbind(dim=-1)
    angle = torch.acos((-z).clamp(-1, 1))
    radius = angle / torch.pi if projection == "angular" else torch.sin(angle / 2)
    scale = radius / torch.sqrt(x * x + y * y).clamp_min(1e-12)
    grid = torch.stack([x * scale, -y * scale], dim=-1)
    sampled = torch.nn.functional.grid_sample(
        image.permute(2, 0, 1)[None], grid[None], mode="bilinear", padding_mode="border", align_corners=False
    )
    return sampled[0].permute(1, 2, 0)
