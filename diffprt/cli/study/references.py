"""Reference pictures path-traced by Mitsuba, for 'diffprt optimize --references'."""

from __future__ import annotations

import time
from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputName, InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import say
from diffprt.cli.terminal import print


def run(
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    light: InputNames = typer.Option(["sky", "studio"], help="sky, studio or a map, turned at random; repeatable."),
    count: int = typer.Option(24, help="Pictures."),
    order: int = typer.Option(6, help="SH bands of the lights."),
    size: int = typer.Option(128, help="Pixels a side."),
    samples: int = typer.Option(256, help="Paths per pixel."),
    bounces: int = typer.Option(6, help="Interreflections."),
    seed: int = typer.Option(0, help="Of views, turns and paths."),
    output: OutputFolder = typer.Option(Path("references"), "-o", "--output", help="The folder."),
    json_file: OutputFile = JsonFile,
) -> None:
    asked = {"order": order, "size": size, "samples": samples, "bounces": bounces, "seed": seed}
    begun = time.perf_counter()
    from diffprt.optimization import save_references
    from diffprt.study.optimization.references import mitsuba_references

    check_output(output, directory=True)
    made = mitsuba_references(source, light, count, **asked, say=say)
    save_references(made, output)
    print(f"{output}: {count} pictures by Mitsuba")
    report = {"settings": {"source": source, "lights": light, **asked}, "counts": {"pictures": count}}
    report |= {"timings": {"total": time.perf_counter() - begun}, "outputs": {"references": str(output)}}
    write_report(json_file, "study references", report)
