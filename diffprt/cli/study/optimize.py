"""What optimization brings over LBG + PCA and over our closed forms, on pictures never seen."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.parsing import parse_clusters
from diffprt.cli.paths import InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say, size_text
from diffprt.cli.terminal import print


def run(
    source: InputNames = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny]"
    ),
    brdf: list[str] = typer.Option(
        ["diffuse"], help="diffuse, or NAME:KEY=VALUE,... as in 'diffprt bake'; repeatable."
    ),
    size: list[str] = typer.Option(["64x8"], help="CLUSTERSxCOMPONENTS; may be repeated."),
    train_light: InputNames = typer.Option(["sky", "studio"], help="sky, studio or a map to train on; repeatable."),
    held_light: InputNames = typer.Option(["sky", "studio"], help="The same of held-out pictures, turned otherwise."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(1, help="Interreflections."),
    pictures: int = typer.Option(24, help="Of training, and as many held out."),
    pixels: int = typer.Option(128, help="Pixels a side."),
    steps: int = typer.Option(100, help="Of training."),
    window: str = typer.Option("auto", help="Of the lights: auto makes them non-negative; none, hann, lanczos, ..."),
    output: OutputFolder = typer.Option(Path("out/optimize"), "-o", "--output", help="The folder; its rows are kept."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.study.optimization.study import optimize_study

    check_output(output, directory=True)
    lights = {"train_lights": train_light, "held_lights": held_light, "window": window}
    numbers = {"order": order, "rays": rays, "bounces": bounces, "pictures": pictures, "size": pixels, "steps": steps}
    sizes = [parse_clusters(text) for text in size]
    report = optimize_study(source or ["builtin:bunny"], output, brdfs=brdf, sizes=sizes, **lights, **numbers, say=say)
    write_report(json_file, "study optimize", report)
    print_optimization(report)


def print_optimization(report: dict) -> None:
    columns = ["method", "clusters", "P", "weights", "bases", "signal", "overdraw", "error"]
    groups: dict[tuple, list[dict]] = {}
    for row in report["rows"]:
        groups.setdefault((row["scene"], row["brdf"], *row["setting"]), []).append(row)
    for (scene, brdf, *_), rows in groups.items():
        table = [
            [
                row["method"],
                str(row["clusters"]),
                str(row["components"]),
                row["weights_format"],
                row["bases_format"],
                size_text(row["bytes"]),
                f"{row['overdraw']:.3f}",
                f"{100 * row['error']:.4f} %",
            ]
            for row in rows
        ]
        print_table(f"{scene}, {brdf}: relative RMSE of held-out pictures", columns, table)
    for entry in report["summary"]:
        falls = ("same_format", "same_bytes", "same_format_closed_form", "same_bytes_closed_form")
        one, two, three, four = (f"{100 * entry[name]:.1f} %" for name in falls)
        five = f"{100 * entry['same_bytes_gradients']:.1f} %"
        print(
            f"{entry['scene']}, {entry['brdf']}: error falls by {one} at the same format and {two} at the same bytes "
            f"against LBG + PCA, by {three} and {four} against the closed form, by {five} in training alone; overdraw "
            f"{'no higher' if entry['overdraw_no_higher'] else 'HIGHER'}"
        )
    for path in report["files"]["sheets"]:
        print(f"picture: {path}")
