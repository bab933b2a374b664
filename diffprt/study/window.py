"""What a window costs in the picture, against the full map under transfer of order 10."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from diffprt.errors import InputError
from diffprt.options import takes
from diffprt.options.study import WindowOptions
from diffprt.rendering import PictureWindow, render
from diffprt.rendering.picture_window import CHOICES, FULL_ORDER
from diffprt.representation import Representation
from diffprt.scene import BUILTIN_ENVIRONMENTS, Camera, Environment, Scene, builtin_environment
from diffprt.transfer import bake

_SIDE = 96
# Of the mean: errors below it are those of rounding, under lights of few bands.
_EQUAL = 1e-4


@takes(WindowOptions)
def window_study(asked: WindowOptions) -> dict:
    """The error of pictures under every map, through every window, of every scene at order `asked.order`.

    A picture's truth is made of transfer and light of order 10; in both, negative radiance becomes 0. The error is the
    RMS over the pixels of the object and its ground, over the truth's RMS.

    Returns:
        settings; `rows`, of each scene and map: the errors by window, "picture" and "auto" among them, what "picture"
        chose, and its error over that of the best fixed window; `worst` and `over`, the greatest such ratio and how
        many exceed 1.1.

    Raises:
        InputError: a scene or map cannot be read; the order is not below 10.
    """
    if not 1 <= asked.order < FULL_ORDER:
        raise InputError(f"order is {asked.order}: give 1 to {FULL_ORDER - 1}, below that of the truth")
    maps, rows = dict(_maps(asked)), []
    for name in asked.scenes:
        asked.say(f"bake {name}")
        scene = Scene.load(name.removesuffix("+ground"))
        scene = scene.with_ground() if name.endswith("+ground") else scene
        baked = [bake(scene, order=order, rays=asked.rays, bounces=1) for order in (asked.order, FULL_ORDER)]
        rows += [{"scene": name, "map": label, **_row(*baked, map_)} for label, map_ in maps.items()]
    ratios = [row["ratio"] for row in rows]
    return {
        "settings": asked.settings(),
        "rows": rows,
        "worst": max(ratios),
        "over": sum(ratio > 1.1 for ratio in ratios),
    }


def _row(asset: Representation, full: Representation, environment: Environment) -> dict:
    camera = Camera.framing(asset.elements.subject, width=_SIDE, height=_SIDE)
    truth = render(full, environment.project(FULL_ORDER), camera).clamp_min(0).double()
    size = float(truth.square().mean().sqrt())
    chosen = PictureWindow.of(asset, camera).project(environment)
    lights = {name: environment.project(asset.order, window=name) for name in (*CHOICES, "auto")}
    errors = {}
    for name, light in {"picture": chosen, **lights}.items():
        shown = render(asset, light, camera).clamp_min(0).double()
        errors[name] = float((shown - truth).square().mean().sqrt()) / max(size, 1e-300)
    best = min(errors[name] for name in CHOICES)
    ratio = 1.0 if errors["picture"] < _EQUAL else errors["picture"] / best
    return {"errors": errors, "chosen": chosen.report["window"], "ratio": ratio}


def _maps(asked: WindowOptions) -> Iterator[tuple[str, Environment]]:
    """Every map as it is, and turned so that its sun comes from other sides."""
    for source in asked.maps:
        known = source in BUILTIN_ENVIRONMENTS
        environment = builtin_environment(source) if known else Environment.load(Path(source))
        for degrees in asked.turns:
            shift = round(environment.image.shape[1] * degrees / 360)
            turned = Environment(environment.image.roll(shift, dims=1), environment.name)
            yield f"{environment.name if not known else source}, {degrees}°", turned
