"""Reference pictures made by our own uncompressed transfer: random views around the object under random lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext

import torch

from diffprt.errors import InputError
from diffprt.optimization.references.references import Reference, References, bounds_of
from diffprt.options.numbers import check_numbers, number_text
from diffprt.rendering import render
from diffprt.rendering.memory import check_picture
from diffprt.representation import Elements, Representation
from diffprt.scene import Camera, Light

# Sine of the elevations that views are drawn from: from a little below the horizon to steeply above it.
_LOWEST, _HIGHEST = -0.25, 0.95


def random_cameras(
    elements: Elements, count: int, *, width: int = 128, height: int = 128, seed: int = 0
) -> list[Camera]:
    """Cameras around the object that frame it, spread evenly over azimuth and over the sine of elevation.

    Args:
        count: how many.
        width, height: of their pictures [pixels].
        seed: any integer; the same one gives the same cameras.
    """
    generator = torch.Generator().manual_seed(seed)
    drawn = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    cameras = []
    for azimuth, sine in drawn.tolist():
        elevation = math.degrees(math.asin(_LOWEST + sine * (_HIGHEST - _LOWEST)))
        cameras.append(
            Camera.framing(elements.positions, azimuth=360 * azimuth, elevation=elevation, width=width, height=height)
        )
    return cameras


def random_rotations(count: int, seed: int = 0) -> torch.Tensor:
    """Rotations float64 [count, 3, 3], uniform over all (from normally distributed quaternions)."""
    generator = torch.Generator().manual_seed(seed)
    q = torch.nn.functional.normalize(torch.randn(count, 4, generator=generator, dtype=torch.float64), dim=1)
    w, x, y, z = q.unbind(1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def random_lights(lights: Sequence[Light], count: int, *, seed: int = 0) -> list[Light]:
    """`count` lights, taken in turn from `lights` and each turned at random."""
    if not lights:
        raise InputError("there are no lights to turn: give one or more")
    return [lights[i % len(lights)].rotate(turn) for i, turn in enumerate(random_rotations(count, seed))]


def make_references(
    asset: Representation,
    lights: Sequence[Light],
    count: int,
    *,
    width: int = 128,
    height: int = 128,
    samples: int = 1,
    turn: bool = True,
    seed: int = 0,
    track: Callable[[str, int], AbstractContextManager[Callable[[], None]]] | None = None,
) -> References:
    """`count` pictures, each from its own view and under its own light.

    Args:
        asset: uncompressed transfer; what a compressed asset of the same scene should look like.
        lights: of the asset's order, taken in turn.
        turn: whether each is turned at random; else one light given is that of all pictures.
        count: at least 1.
        width, height: of the pictures [pixels].
        samples: samples a side of each pixel.
        seed: of views and rotations.
        track: as `diffprt.progress.track`, shows progress.

    Raises:
        InputError: the asset is compressed or has no triangles, the count is below 1, or a light has another order.
    """
    if asset.compressed:
        raise InputError("references are made of uncompressed transfer, this asset is compressed: give what bake made")
    if not 1 <= count <= 100_000:
        raise InputError(f"reference set has {number_text(count)} pictures: give 1 to 100000")
    check_numbers({"seed": seed, "samples": samples})
    check_picture(Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), width=width, height=height), samples, count)
    cameras = random_cameras(asset.elements, count, width=width, height=height, seed=seed)
    turned = random_lights(lights, count, seed=seed)
    shown = turned if turn else [lights[i % len(lights)] for i in range(count)]
    entries = []
    with (track or (lambda text, total: nullcontext(lambda: None)))("rendering references", count) as advance:
        for camera, light in zip(cameras, shown, strict=True):
            image = render(asset, light, camera, samples=samples).detach().float()
            entries.append(Reference(image, camera, light.coefficients.detach().float()))
            advance()
    return References(tuple(entries), asset.scene_hash, bounds_of(asset.elements), samples)
