"""Reference pictures made by Mitsuba: effects that a bake never saw, for `diffprt optimize`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.optimization import Reference, References, random_cameras, random_lights
from diffprt.optimization.references.references import bounds_of
from diffprt.scene import Scene, load_scene
from diffprt.study.lights import named_light
from diffprt.study.mitsuba.scene import mitsuba_scene, path_trace, start_mitsuba
from diffprt.surface import Surfaces

# Samples a side with which models of the pictures average pixels, as the path tracer's box filter does.
_SAMPLES = 4


def mitsuba_references(
    source: str | Path | Scene,
    lights: Sequence[str],
    count: int,
    *,
    order: int = 6,
    size: int = 128,
    samples: int = 256,
    bounces: int = 6,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> References:
    """Path-traced pictures of random views under lights turned at random.

    Args:
        source: a scene file, "builtin:NAME" or a scene.
        lights: built-in environments or maps; each is projected at `order` and made non-negative (`window="auto"`).
        count: pictures.
        size: pixels a side.
        samples: paths per pixel.
        bounces: interreflections.
        seed: of views, turns and paths.

    Raises:
        InputError: Mitsuba is missing, or an option is out of range.
    """
    if not 1 <= count <= 10_000 or samples < 1 or size < 8:
        raise InputError(f"count is {count}, samples {samples}, size {size}: give 1 to 10000, 1 or more, 8 or more")
    mitsuba, note = start_mitsuba()
    if note:
        say(f"note: {note}")
    scene = load_scene(source)
    receivers = Surfaces.of(scene).receivers
    projected = [named_light(name, order, window="auto") for name in lights]
    cameras = random_cameras(receivers, count, width=size, height=size, seed=seed)
    entries = []
    for index, (camera, light) in enumerate(zip(cameras, random_lights(projected, count, seed=seed), strict=True)):
        built = mitsuba_scene(mitsuba, scene, light, camera)
        traced = path_trace(mitsuba, built, bounces=bounces, samples=samples, seed=seed * count + index)
        coefficients = light.coefficients.detach().to(torch.float32)
        entries.append(Reference(traced[..., :3].float(), camera, coefficients))
        say(f"picture {index + 1} of {count}")
    return References(tuple(entries), scene.hash(), bounds_of(receivers), _SAMPLES)
