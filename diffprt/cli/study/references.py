"""Reference pictures path-traced by Mitsuba, for 'diffprt optimize --references'."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import check_output
from diffprt.cli.paths import InputName, InputNames, OutputFolder
from diffprt.cli.tables import say


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
) -> None:
    asked = {name: value for name, value in locals().items() if name not in ("source", "light", "count", "output")}
    from diffprt.optimization import save_references
    from diffprt.study.optimization.references import mitsuba_references

    check_output(output, directory=True)
    made = mitsuba_references(source, light, count, **asked, say=say)
    save_references(made, output)
    print(f"{output}: {count} pictures by Mitsuba")
