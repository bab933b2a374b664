"""The main job from end to end on an embedded scene: bake, compress, render, export."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import torch
from kornia.metrics import psnr

from diffprt.compression import compress
from diffprt.exporters import export
from diffprt.progress import Track, timed, untracked
from diffprt.rendering import auto_exposure, render
from diffprt.rendering.sheet import contact_sheet
from diffprt.representation import Representation
from diffprt.representation import files as assets
from diffprt.scene import Camera, Light, builtin_environment, builtin_scene
from diffprt.shading import tone_map
from diffprt.transfer import trace
from diffprt.transfer.diffuse.direct import open_transfer

LIGHTS = ("sky", "studio")
BUNNY_ALBEDO = (0.80, 0.62, 0.46)


@dataclass
class DemoResult:
    """What the demo made.

    Attributes:
        stages: seconds by stage, in order.
        sheet, page, bake, compressed: paths.
        counts, errors: figures for people.
    """

    sheet: Path
    page: Path
    baked: Path
    compressed: Path
    stages: dict[str, float] = field(default_factory=dict)
    counts: dict[str, float] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)


def run_demo(
    directory: Path,
    *,
    order: int = 6,
    rays: int = 1024,
    bounces: int = 2,
    clusters: int = 128,
    components: int = 8,
    size: int = 384,
    track: Track = untracked,
    stage_begins: Callable[[str], None] = lambda name: None,
) -> DemoResult:
    """Bakes, compresses, renders and exports the demo scene into `directory`."""
    # Few bands have fewer components than that.
    components = min(components, order * order)
    result = DemoResult(
        directory / "contact_sheet.png",
        directory / "page" / "index.html",
        directory / "bunny.prt",
        directory / "bunny_compressed.prt",
    )

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        stage_begins(name)
        with timed(result.stages, name):
            yield

    with stage("scene and lights"):
        # 48,800 triangles on a ground that catches their shadow.
        bunny = builtin_scene("bunny").with_albedo(torch.tensor(BUNNY_ALBEDO))
        scene = bunny.with_ground(albedo=0.5)
        lights = {name: builtin_environment(name).project(order, window="hann") for name in LIGHTS}
    report: dict = {}
    with stage("visibility and first hits"):
        transport = trace(scene, order=order, rays=rays, bounces=bounces, track=track, report=report)
    with stage("interreflection"):
        shadowed = transport.transfer(0)
        reflected = transport.transfer(bounces)
    unshadowed = shadowed.with_signal(open_transfer(shadowed.receivers.normals, order).float()[:, None])
    with stage("compression"):
        compressed = compress(reflected, clusters=clusters, components=components)
    with stage("assets"):
        assets.save(reflected, result.baked)
        assets.save(compressed, result.compressed)
    columns = {
        "unshadowed": unshadowed,
        "shadowed": shadowed,
        f"interreflected ({bounces} bounces)": reflected,
        f"compressed ({clusters} x {components})": compressed,
    }
    # On the bunny, not on the whole of its ground.
    around = scene.meshes[0].positions
    camera = Camera.framing(around, azimuth=20, elevation=18, margin=1.35, width=size, height=size)
    with stage("pictures"):
        pictures, balanced = _pictures(columns, lights, camera)
        contact_sheet(result.sheet, pictures, list(columns), list(lights))
    with stage("page"):
        title = f"Bunny, {clusters} clusters x {components} components"
        page = export(compressed, directory / "page", lights=balanced, camera=camera, title=title)
    last, before = pictures[-1][-1], pictures[-1][-2]
    result.counts = {
        **report["counts"],
        "bytes_baked": reflected.nbytes,
        "bytes_compressed": compressed.nbytes,
        "bytes_page": page["bytes"],
    }
    result.errors = {
        **compressed.certificate,
        "compressed_psnr_db": float(psnr(last.permute(2, 0, 1), before.permute(2, 0, 1), 1.0)),
    }
    return result


def _pictures(
    columns: dict[str, Representation], lights: dict[str, Light], camera: Camera
) -> tuple[list[list[torch.Tensor]], dict[str, Light]]:
    """Display images by light and column, one exposure per light; and the lights scaled by it."""
    reference = list(columns.values())[2]
    mask = reference.elements.view(camera).mask
    rows, balanced = [], {}
    for name, light in lights.items():
        factor = auto_exposure(render(reference, light, camera), mask)
        balanced[name] = Light(light.coefficients * factor, light.report)
        images = [render(a, balanced[name], camera, background="light", samples=2) for a in columns.values()]
        rows.append([tone_map(image, curve="aces") for image in images])
    return rows, balanced
