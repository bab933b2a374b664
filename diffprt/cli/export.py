"""Write an asset as a page that relights it in a browser, and as glTF and shaders for engines."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from diffprt.cli.from_options import field_option
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.parsing import parse_budget, parse_point
from diffprt.cli.paths import InputFile, InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import size_text
from diffprt.cli.terminal import print
from diffprt.errors import InputError
from diffprt.options import LIGHTS, ExportOptions, ViewOptions

if TYPE_CHECKING:
    from diffprt.scene import Light


def run(
    source: InputFile = typer.Argument(..., metavar="ASSET", help="A .prt file."),
    output: OutputFolder = typer.Option(Path("page"), "-o", "--output", help="The folder to write index.html into."),
    light: InputNames = typer.Option(list(LIGHTS), help="sky, studio, constant or a map; may be repeated."),
    window: str = field_option(ViewOptions, "window"),
    azimuth: float = field_option(ViewOptions, "azimuth"),
    elevation: float = field_option(ViewOptions, "elevation"),
    target: str = field_option(ViewOptions, "target"),
    distance: float = field_option(ViewOptions, "distance"),
    fov: float = field_option(ViewOptions, "fov"),
    curve: str = field_option(ExportOptions, "curve"),
    title: str = field_option(ExportOptions, "title"),
    registers: int = field_option(ExportOptions, "registers"),
    uncompressed: InputFile = field_option(ExportOptions, "uncompressed"),
    before: InputFile = field_option(ExportOptions, "before"),
    versions: InputNames = field_option(ExportOptions, "versions", default=[], metavar="NAME=FILE"),
    bytes: str = field_option(ExportOptions, "bytes"),
    glb: bool = typer.Option(False, "--glb", help="Also scene.glb, and prt.three.js with an example that shows it."),
    shaders: bool = typer.Option(False, "--shaders", help="Also its shaders as GLSL, GLSL ES, HLSL and WGSL."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.cli.scenes import load_light
    from diffprt.exporters import export, export_glb, write_shaders, write_three
    from diffprt.exporters.gltf.three_module import three_kinds
    from diffprt.exporters.web.lights import balanced_light
    from diffprt.rendering import PictureWindow, clipped_share, render
    from diffprt.representation import files as assets
    from diffprt.scene import Camera

    aim = None if target is None else parse_point(target, "target")
    begun = time.perf_counter()
    asset = assets.load(source)
    others = dict(_named(text) for text in versions)
    camera = Camera.framing(
        asset.elements.subject, azimuth=azimuth, elevation=elevation, fov=fov, target=aim, distance=distance
    )
    picture = PictureWindow.of(asset, camera) if window == ViewOptions.window and asset.order else None
    lights: dict[str, Light] = {}
    for name in light:
        stem = Path(name).stem.removeprefix("builtin:")
        shown = next(n for n in (stem, *(f"{stem} {i}" for i in range(2, len(light) + 2))) if n not in lights)
        projected = load_light(name, asset.order, window=window, picture=picture)
        lights[shown] = balanced_light(asset, projected, camera, curve=curve)
    check_output(output, directory=True)
    report = export(
        asset,
        output,
        lights=lights,
        camera=camera,
        window=window,
        curve=curve,
        title=title or source.stem,
        registers=registers,
        bytes=parse_budget(bytes),
        versions={name: assets.load(path) for name, path in others.items()},
        uncompressed=None if uncompressed is None else assets.load(uncompressed),
        before=None if before is None else assets.load(before),
    )
    shown = {"page": "viewer"}
    parts = ", ".join(f"{shown.get(name, name)} {size_text(size)}" for name, size in report["parts"].items())
    print(f"{report['path']}: page {size_text(report['bytes'])} ({parts}); open it in a browser")
    small, told = replace(camera, width=64, height=64), {}
    for name, lit in lights.items():
        clipped = clipped_share(render(asset, lit, small), asset.elements.view(small).mask)
        told[name] = {**lit.report, "negative_radiance_clipped": clipped}
        print(f"{name}: window {lit.report['window']}, {100 * clipped:.2g} % of radiance was negative and clipped")
    for what in report["left_out"]:
        print(f"left out: {what}")
    if glb:
        report["glb"] = export_glb(asset, output / "scene.glb", lights=lights, name=title or source.stem)
        drawn = report["glb"]["kind"] in three_kinds()
        told = "example.html shows it with three.js" if drawn else "no three.js module draws it yet"
        print(f"{report['glb']['path']}: file {size_text(report['glb']['bytes'])}; {told}")
        report["three"] = [str(path) for path in write_three(output)] if drawn else []
    if shaders:
        sizes = {} if registers is None else {"REGISTERS": registers}
        report["shaders"] = [str(path) for path in write_shaders(output / "shaders", report["programs"], sizes=sizes)]
        print(f"{output / 'shaders'}: {len(report['shaders'])} files, {', '.join(report['programs'])}")
    write_report(
        json_file,
        "export",
        {
            "settings": {
                "lights": list(lights),
                "window": window,
                "curve": curve,
                "registers": registers,
                "bytes": parse_budget(bytes),
            },
            "timings": {"total": time.perf_counter() - begun},
            "counts": report.pop("counts"),
            "errors": asset.certificate,
            "lights": told,
            "outputs": report,
        },
    )


def _named(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise InputError(f"--versions is '{text}': give NAME=FILE")
    return name, Path(path)
