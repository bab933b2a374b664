"""Commands of the optimization study, and what they print."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from diffprt.cli.report import JsonFile, check_output, print_table, size_text, write_report
from diffprt.errors import InputError
from diffprt.optimize import load_references, save_references


def optimize(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny]"
    ),
    brdf: list[str] = typer.Option(
        ["diffuse"], help="diffuse, or NAME:KEY=VALUE,... as in 'diffprt bake'; repeatable."
    ),
    size: list[str] = typer.Option(["64x8"], help="CLUSTERSxCOMPONENTS; may be repeated."),
    train_light: list[str] = typer.Option(["sky", "studio"], help="sky, studio or a map to train on; repeatable."),
    held_light: list[str] = typer.Option(["sky", "studio"], help="The same of held-out pictures, turned otherwise."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(1, help="Interreflections of diffuse transfer."),
    pictures: int = typer.Option(24, help="Of training, and as many held out."),
    pixels: int = typer.Option(128, help="Pixels a side."),
    steps: int = typer.Option(100, help="Of training."),
    window: str = typer.Option("auto", help="Of the lights: auto makes them non-negative; none, hann, lanczos, ..."),
    output: Path = typer.Option(Path("out/optimize"), "-o", "--output", help="The folder; its rows are kept."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.optimize import optimize_study

    check_output(output, directory=True)
    report = optimize_study(
        source or ["builtin:bunny"],
        output,
        brdfs=brdf,
        sizes=[_clusters_and_components(text) for text in size],
        train_lights=train_light,
        held_lights=held_light,
        order=order,
        rays=rays,
        bounces=bounces,
        pictures=pictures,
        size=pixels,
        steps=steps,
        window=window,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study optimize", report)
    _print(report)


def references(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    light: list[str] = typer.Option(["sky", "studio"], help="sky, studio or a map, turned at random; repeatable."),
    count: int = typer.Option(24, help="Pictures."),
    order: int = typer.Option(6, help="SH bands of the lights."),
    size: int = typer.Option(128, help="Pixels a side."),
    samples: int = typer.Option(256, help="Paths per pixel."),
    bounces: int = typer.Option(6, help="Interreflections."),
    seed: int = typer.Option(0, help="Of views, turns and paths."),
    output: Path = typer.Option(Path("references"), "-o", "--output", help="The folder."),
) -> None:
    from diffprt.study.optimize_references import mitsuba_references

    check_output(output, directory=True)
    made = mitsuba_references(
        source,
        light,
        count,
        order=order,
        size=size,
        samples=samples,
        bounces=bounces,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    save_references(made, output)
    print(f"{output}: {count} pictures by Mitsuba")


def unseen(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="The scene of the references."),
    folder: Path = typer.Option(..., "--references", help="A folder made by 'diffprt study references'."),
    size: str = typer.Option("64x8", help="CLUSTERSxCOMPONENTS."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    steps: int = typer.Option(100, help="Of training."),
    output: Path = typer.Option(Path("out/unseen"), "-o", "--output", help="The folder for the sheet."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.optimize_unseen import unseen_study

    check_output(output, directory=True)
    made = load_references(folder)
    clusters, components = _clusters_and_components(size)
    options = {"clusters": clusters, "components": components, "order": made.order, "rays": rays, "steps": steps}
    report = unseen_study(source, made, output, **options)
    write_report(json_file, "study unseen", report)
    before, after = (100 * report["errors"][name] for name in ("before", "after"))
    print(f"error of held-out pictures: {before:.2f} % before, {after:.2f} % after")
    print(f"picture: {report['files']['sheet']}")


def _clusters_and_components(text: str) -> tuple[int, int]:
    try:
        clusters, components = (int(part) for part in text.split("x"))
    except ValueError:
        raise InputError(f"size is '{text}': give CLUSTERSxCOMPONENTS such as 64x8") from None
    return clusters, components


def _print(report: dict) -> None:
    columns = ["method", "clusters", "P", "weights", "bases", "bytes", "overdraw", "error"]
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
