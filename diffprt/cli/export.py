"""Write an asset as a page that relights it in a browser, and as glTF and shaders for engines."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from diffprt.cli.from_options import field_option
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.parsing import parse_budget
from diffprt.cli.tables import size_text
from diffprt.errors import InputError
from diffprt.options import ExportOptions

if TYPE_CHECKING:
    from diffprt.scene import Light


def run(
    source: Path = typer.Argument(..., metavar="ASSET", help="A .prt file."),
    output: Path = typer.Option(Path("page"), "-o", "--output", help="The folder to write index.html into."),
    light: list[str] = typer.Option(["sky", "studio"], help="sky, studio, constant or a map; may be repeated."),
    window: str = typer.Option("hann", help="none, hann, lanczos or auto: trades contrast for less ringing."),
    curve: str = field_option(ExportOptions, "curve"),
    title: str = field_option(ExportOptions, "title"),
    registers: int = field_option(ExportOptions, "registers"),
    uncompressed: Path = field_option(ExportOptions, "uncompressed"),
    before: Path = field_option(ExportOptions, "before"),
    versions: list[str] = field_option(ExportOptions, "versions", default=[], metavar="NAME=FILE"),
    bytes: str = field_option(ExportOptions, "bytes"),
    glb: bool = typer.Option(False, "--glb", help="Also scene.glb, and prt.three.js with an example that shows it."),
    shaders: bool = typer.Option(False, "--shaders", help="Also its shaders as GLSL, GLSL ES, HLSL and WGSL."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.cli.scenes import load_light
    from diffprt.exporters import export, export_glb, write_shaders, write_three
    from diffprt.exporters.gltf.three_module import three_kinds
    from diffprt.exporters.web.lights import balanced_light
    from diffprt.representation import files as assets

    begun = time.perf_counter()
    asset = assets.load(source)
    others = dict(_named(text) for text in versions)
    lights: dict[str, Light] = {}
    for name in light:
        stem = Path(name).stem.removeprefix("builtin:")
        shown = next(n for n in (stem, *(f"{stem} {i}" for i in range(2, len(light) + 2))) if n not in lights)
        lights[shown] = balanced_light(asset, load_light(name, asset.order, window=window))
    check_output(output, directory=True)
    report = export(
        asset,
        output,
        lights=lights,
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
            "outputs": report,
        },
    )


def _named(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise InputError(f"--versions is '{text}': give NAME=FILE")
    return name, Path(path)
