"""A gradient step through a picture, timed beside Mitsuba's prb, and its direction compared."""

from __future__ import annotations

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.paths import InputName, OutputFile
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import GradientOptions


@from_options(GradientOptions)
def run(
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    json_file: OutputFile = JsonFile,
    *,
    options: GradientOptions,
) -> None:
    from diffprt.study.gradient.study import gradient_study

    report = gradient_study(source, **vars(options) | {"say": say})
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
