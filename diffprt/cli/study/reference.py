"""Render against a Mitsuba path trace of the same scene under the same light."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.parsing import parse_color
from diffprt.cli.paths import InputName, InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import print_table
from diffprt.cli.terminal import print


def run(
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    light: InputNames = typer.Option(["sky", "studio"], help="sky, studio or a map; may be repeated."),
    output: OutputFolder = typer.Option(Path("out/reference"), "-o", "--output", help="The folder for pictures."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(4096, help="Rays per receiver."),
    bounces: int = typer.Option(6, help="Interreflections."),
    size: int = typer.Option(256, help="Pixels a side."),
    samples: int = typer.Option(1024, help="Mitsuba's samples per pixel, in each of two halves."),
    albedo: str = typer.Option(None, help="Replaces every albedo: 0.8 or r,g,b."),
    brdf: list[str] = typer.Option([], help="Makes surfaces glossy, as in 'diffprt bake'; may be repeated."),
    order_out: int = typer.Option(None, help="With --brdf: SH bands of exit radiance; --order by default."),
    up: str = typer.Option(None, help="The axis of the file that points up; y by default."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.brdf import parse_brdf
    from diffprt.study.reference.study import reference_study

    color = None if albedo is None else parse_color(albedo, "albedo")
    check_output(output, directory=True)
    brdfs = [parse_brdf(text) for text in brdf]
    numbers = {"order": order, "rays": rays, "bounces": bounces, "size": size, "samples": samples}
    report = reference_study(source, light, output, albedo=color, brdf=brdfs, order_out=order_out, up=up, **numbers)
    for note in report["notes"]:
        print(f"note: {note}")
    shares = ("relative_rmse", "resolution", "noise", "difference")
    rows = [
        [r["light"], *(f"{100 * r[key]:.2f} %" for key in shares), f"{r['mean_ratio']:.4f}"] for r in report["rows"]
    ]
    columns = ["light", "error", "resolved to", "noise", "difference", "mean ratio"]
    print_table(f"{source} against Mitsuba (error: difference less noise)", columns, rows)
    print(f"pictures: {output}")
    write_report(json_file, "study reference", report)
