"""Studies: diffprt set beside others, with figures."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from diffprt.cli.inputs import parse_color
from diffprt.cli.report import JsonFile, check_output, print_table, write_report
from diffprt.cli.study_tables import print_tolerance, print_visibility
from diffprt.scene import BUILTIN_SCENES

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None)


@app.command(help="Render against a Mitsuba path trace of the same scene under the same light.")
def reference(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    light: list[str] = typer.Option(["sky", "studio"], help="sky, studio or a map; may be repeated."),
    output: Path = typer.Option(Path("out/reference"), "-o", "--output", help="The folder for pictures."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(4096, help="Rays per receiver."),
    bounces: int = typer.Option(6, help="Diffuse interreflections."),
    size: int = typer.Option(256, help="Pixels a side."),
    samples: int = typer.Option(1024, help="Mitsuba's samples per pixel, in each of two halves."),
    albedo: str = typer.Option(None, help="Replaces every albedo: 0.8 or r,g,b."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.reference import reference_study

    color = None if albedo is None else parse_color(albedo, "albedo")
    check_output(output, directory=True)
    report = reference_study(
        source,
        light,
        output,
        order=order,
        rays=rays,
        bounces=bounces,
        size=size,
        samples=samples,
        albedo=color,
    )
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


@app.command(help="Rays per second, structure and exactness of visibility, beside Embree and Mitsuba.")
def visibility(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny builtin:closed_box]"
    ),
    output: Path = typer.Option(Path("out/visibility"), "-o", "--output", help="The folder for the chart."),
    rays: list[int] = typer.Option([256, 2048], help="Rays per receiver; may be repeated."),
    runs: int = typer.Option(5, help="Rounds in which all take turns."),
    seconds: float = typer.Option(1.0, help="Least length of one timing."),
    large: int = typer.Option(1_500_000, help="Triangles of the mesh whose structure is built; 0 for none."),
    test_rays: int = typer.Option(1_000_000, help="Rays of the escape test and against brute force."),
    brute_tests: float = typer.Option(1e10, help="Most triangle tests of brute force per scene."),
    seed: int = typer.Option(0, help="Draws receivers and directions."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.visibility import visibility_study

    check_output(output, directory=True)
    report = visibility_study(
        source or ["builtin:bunny", "builtin:closed_box"],
        output,
        rays=rays,
        runs=runs,
        seconds=seconds,
        large=large,
        test_rays=test_rays,
        brute_tests=brute_tests,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study visibility", report)
    print_visibility(report)


@app.command(help="Whether --tolerance delivers, and at which cost against the best fixed number of rays.")
def tolerance(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: every built-in scene]"
    ),
    data: Path = typer.Option(None, help="A folder whose meshes are added."),
    random: int = typer.Option(12, help="Random scenes that are added."),
    tolerance: list[float] = typer.Option([0.03, 0.01], help="Relative errors asked for; may be repeated."),
    bounces: list[int] = typer.Option([0, 2], help="Diffuse interreflections; may be repeated."),
    order: int = typer.Option(6, help="SH bands."),
    seed: int = typer.Option(0, help="Of bakes, and of the first random scene."),
    truth_rays: int = typer.Option(20_000_000, help="Most rays of a truth; fewer receivers are compared beyond it."),
    output: Path = typer.Option(Path("out/tolerance"), "-o", "--output", help="The folder for rows and chart."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.tolerance import tolerance_study

    check_output(output, directory=True)
    report = tolerance_study(
        source or [f"builtin:{name}" for name in BUILTIN_SCENES],
        output,
        data=data,
        random=random,
        tolerances=tolerance,
        bounces=bounces,
        order=order,
        seed=seed,
        truth_rays=truth_rays,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study tolerance", report)
    print_tolerance(report)
