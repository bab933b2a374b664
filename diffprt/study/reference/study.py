"""Pictures of baked transfer beside a path tracer's, under the same band-limited light.

The light is projected at the bake's order, so that truncation of transfer costs nothing: what is compared is
transport, not how well few bands describe a light. It is made non-negative by the automatic window rather
than by a constant added. A constant would light the scene evenly, raise the mean that errors are relative to,
and so flatter them; and the window is what users have (`--window auto`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import torch

from diffprt.brdf import Brdf, describe_brdf
from diffprt.errors import InputError
from diffprt.images import write_image
from diffprt.progress import status, track
from diffprt.rendering import render
from diffprt.scene import Camera, Light, Scene, load_scene
from diffprt.study.lights import named_light
from diffprt.study.mitsuba.bsdf import mitsuba_bsdf
from diffprt.study.mitsuba.scene import mitsuba_scene, path_trace, start_mitsuba
from diffprt.study.reference.agreement import agreement, eroded
from diffprt.study.reference.comparison_sheet import comparison_sheet
from diffprt.surface import Receivers
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer import GlossyTransfer, Transfer, bake, bake_glossy
from diffprt.whole_file import make_folder

# Samples a side of our pixels: edges inside the object are averaged as the path tracer's box filter does.
_SAMPLES = 4


def reference_study(
    source: str | Path | Scene,
    lights: list[str],
    output: str | Path,
    *,
    order: int = 6,
    rays: int = 4096,
    bounces: int = 6,
    size: int = 256,
    samples: int = 1024,
    albedo: float | tuple[float, float, float] | None = None,
    brdf: Sequence[Brdf] = (),
    order_out: int | None = None,
    up: str | None = None,
) -> dict:
    """Bakes a scene, renders it under each light and compares with Mitsuba's path tracer.

    Args:
        source: a scene file, "builtin:NAME" or a scene.
        lights: "sky", "studio", "constant" or equirectangular maps.
        output: folder for a sheet, two pictures (EXR) and their difference (EXR) per light.
        order: SH bands of transfer and light.
        rays: rays per receiver.
        bounces: interreflections; Mitsuba's paths are as long.
        size: pixels a side.
        samples: Mitsuba's paths per pixel in each of two independent halves.
        albedo: replaces every albedo.
        brdf: makes surfaces glossy: one for all, or one per material.
        order_out: SH bands of glossy exit radiance; `order` without it.
        up: the axis of a scene file that points up; "y" without it.

    Returns:
        Plain numbers: `settings`, `versions`, `notes`, `counts`, `timings` and `rows`, one per light, with
        the entries of `agreement`, the window's report, seconds and the files written.

    Raises:
        InputError: Mitsuba is missing, or an option is out of range.
    """
    if samples < 1 or size < 8:
        raise InputError(f"samples is {samples} and size {size}: give samples of 1 and a size of 8 or more")
    mitsuba, note = start_mitsuba()
    if len(brdf) and albedo is not None:
        raise InputError("albedo is given with brdf, which has its own reflectance: leave one of them out")
    # What Mitsuba does not know is refused before the bake.
    for one in brdf:
        mitsuba_bsdf(mitsuba, one)
    scene = load_scene(source) if up is None else Scene.load(source, up=up)
    if albedo is not None:
        scene = scene.with_albedo(torch.as_tensor(albedo, dtype=torch.float32))
    # All lights are read before the first ray is traced: a wrong name costs no time.
    projected = [named_light(name, order, window="auto") for name in lights]
    baked: dict = {}
    options = {"order": order, "rays": rays, "bounces": bounces, "track": track, "report": baked}
    if len(brdf):
        transfer = bake_glossy(scene, brdf[0] if len(brdf) == 1 else brdf, order_out=order_out, **options)
    else:
        transfer = bake(scene, **options)
    camera = Camera.framing(transfer.receivers.positions, width=size, height=size)
    visible = receiver_pixels(scene, camera)
    output = Path(output)
    make_folder(output)
    rows = []
    for name, light in zip(lights, projected, strict=True):
        paths = {"bounces": bounces, "samples": samples, "brdf": brdf}
        with status(f"path tracing under {Path(name).stem}"):
            row, pictures = compare(mitsuba, scene, transfer, light, camera, visible, **paths)
        files = _write(output, f"{scene.name}_{Path(name).stem}", pictures, row)
        rows.append({"light": Path(name).stem, **row, "window": light.report, "files": files})
    return {
        "settings": {
            "scene": str(source) if not isinstance(source, Scene) else scene.name,
            "order": order,
            "rays": rays,
            "bounces": bounces,
            "max_depth": bounces + 2,
            "size": size,
            "samples_per_half": samples,
            "samples_a_side": _SAMPLES,
            "albedo": albedo,
            "brdf": [describe_brdf(b) for b in brdf],
            "up": up,
            "order_out": transfer.order_out if len(brdf) else None,
            "window": "auto",
            "mask": "fully covered in both pictures, less one pixel at the border",
            "camera": {"eye": camera.eye, "target": camera.target, "fov": camera.fov},
        },
        "versions": {"mitsuba": mitsuba.__version__, "variant": mitsuba.variant()},
        "notes": [note] if note else [],
        "counts": baked["counts"],
        "timings": {"bake": baked["timings"]["total"]},
        "errors": baked["errors"],
        "rows": rows,
    }


def compare(
    mitsuba,
    scene: Scene,
    transfer: Transfer | GlossyTransfer,
    light: Light,
    camera: Camera,
    visible: torch.Tensor,
    *,
    bounces: int,
    samples: int,
    brdf: Sequence[Brdf] = (),
    reference_light: Light | None = None,
) -> tuple[dict, dict]:
    """One picture of `transfer` against two halves from Mitsuba.

    Args:
        visible: bool [H, W] from `receiver_pixels`.
        brdf: what glossy transfer was baked with.
        reference_light: what Mitsuba gets in place of `light`, to see that the comparison tells them apart.

    Returns:
        The numbers of `agreement` with seconds, and pictures: "ours", "mitsuba" [H, W, 3], "mask" [H, W].
    """
    begun = time.perf_counter()
    ours = render(transfer, light, camera, samples=_SAMPLES)
    rendered = time.perf_counter()
    target = mitsuba_scene(mitsuba, scene, reference_light or light, camera, brdf)
    halves = [path_trace(mitsuba, target, bounces=bounces, samples=samples, seed=seed) for seed in (0, 1)]
    traced = time.perf_counter()
    covered = visible & (halves[0][..., 3] > 1 - 1e-6) & (halves[1][..., 3] > 1 - 1e-6)
    mask = eroded(covered)
    if not bool(mask.any()):
        raise InputError("no pixel lies inside the object in both pictures: give a larger size")
    one, two = (half[..., :3] for half in halves)
    row = agreement(ours, (one, two), mask)
    row |= {"seconds_ours": rendered - begun, "seconds_mitsuba": traced - rendered}
    return row, {"ours": ours, "mitsuba": (one + two) / 2, "mask": mask}


def receiver_pixels(scene: Scene, camera: Camera) -> torch.Tensor:
    """Pixels [H, W] all of whose samples see a surface that is shown, not an occluder-only mesh before it."""
    surfaces = Surfaces.of(scene)
    nothing = torch.zeros_like(surfaces.positions)
    everything = Receivers(surfaces.positions, nothing, nothing, surfaces.faces)
    fine = Camera(camera.eye, camera.target, camera.up, camera.fov, camera.width * _SAMPLES, camera.height * _SAMPLES)
    view = everything.view(fine)
    shown = torch.zeros(len(surfaces.positions), dtype=torch.bool)
    shown[surfaces.faces[(surfaces.source_of_corner >= 0).all(1)].reshape(-1)] = True
    seen = view.framed(shown[view.index].all(-1))
    return seen.reshape(camera.height, _SAMPLES, camera.width, _SAMPLES).all(3).all(1)


def _write(output: Path, stem: str, pictures: dict, row: dict) -> dict:
    ours, theirs, mask = pictures["ours"], pictures["mitsuba"], pictures["mask"]
    files = {key: str(output / f"{stem}_{key}.exr") for key in ("ours", "mitsuba", "difference")}
    write_image(files["ours"], ours)
    write_image(files["mitsuba"], theirs)
    write_image(files["difference"], (ours - theirs) * mask[..., None])
    files["sheet"] = str(output / f"{stem}.png")
    title = (
        f"{stem}: error {100 * row['relative_rmse']:.2f} % without the reference's noise of "
        f"{100 * row['noise']:.2f} %, mean ratio {row['mean_ratio']:.4f}"
    )
    comparison_sheet(files["sheet"], ours, theirs, mask, names=("diffprt", "Mitsuba"), title=title)
    return files
