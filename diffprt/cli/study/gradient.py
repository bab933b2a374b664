"""A gradient step through a picture, timed beside Mitsuba's prb, and its direction compared."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.tables import print_table, say


def run(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    order: int = typer.Option(6, help="SH bands of transfer and light."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(2, help="Interreflections, of Mitsuba's paths too."),
    size: int = typer.Option(256, help="Pixels a side."),
    samples: int = typer.Option(16, help="Mitsuba's samples per pixel of a timed step."),
    rows: int = typer.Option(32, help="Rows of the environment map whose texels are optimized."),
    rounds: int = typer.Option(7, help="In which all take turns."),
    truth_samples: int = typer.Option(1024, help="Mitsuba's samples per pixel of the gradients compared."),
    halves: int = typer.Option(2, help="Independent gradients of so many samples."),
    seed: int = typer.Option(0, help="Of the bake and of Mitsuba."),
    json_file: Path = JsonFile,
) -> None:
    asked = {name: value for name, value in locals().items() if name not in ("source", "json_file")}
    from diffprt.study.gradient.study import gradient_study

    report = gradient_study(source, **asked, say=say)
    write_report(json_file, "study gradient", report)
    print_gradient(report)


def print_gradient(report: dict) -> None:
    """The tables of `gradient_study`."""
    settings, seconds, ratios = report["settings"], report["seconds"], report["ratios"]
    rows = []
    for name, spread in seconds.items():
        low, median, high = (f"{1e3 * spread[key]:.3g}" for key in ("low", "median", "high"))
        rows.append([name, median, f"{low} .. {high}"])
        rows[-1] += [f"{of[name]['median']:.0f} x" if name in of else "-" for of in ratios.values()]
    view = f"{settings['size']} x {settings['size']} pixels of {settings['scene']}, order {settings['order']}"
    print_table(
        f"A gradient step of {view}; Mitsuba at {settings['samples']} samples, medians of {settings['rounds']} rounds",
        ["step to", "ms", "quartiles", *(f"faster than {name}" for name in ratios)],
        rows,
    )
    setup = ", ".join(f"{name} {value:.3g} s" for name, value in report["setup"].items() if "first" not in name)
    print(f"done once: {setup}")
    cosine = report["cosine"]
    bands = ", ".join(f"{value:.4f}" for value in cosine["bands"])
    print(
        f"cosine of the gradient to the light with Mitsuba's of {settings['halves']} x {settings['truth_samples']} "
        f"samples: {cosine['overall']:.5f} (bands {bands}; Mitsuba's halves {cosine['between_halves']:.5f})"
    )
