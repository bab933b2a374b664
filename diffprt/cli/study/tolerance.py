"""Whether --tolerance delivers, and at which cost against the best fixed number of rays."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputFile, InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import ToleranceOptions


@from_options(ToleranceOptions)
def run(
    *,
    source: InputNames = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: every built-in scene]"
    ),
    data: InputFile = typer.Option(None, help="A folder whose meshes are added."),
    random: int = typer.Option(12, help="Random scenes that are added."),
    options: ToleranceOptions,
    output: OutputFolder = typer.Option(Path("out/tolerance"), "-o", "--output", help="The folder for rows and chart."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.scene import BUILTIN_SCENES
    from diffprt.study.tolerance.study import tolerance_study

    check_output(output, directory=True)
    report = tolerance_study(
        source or [f"builtin:{name}" for name in BUILTIN_SCENES],
        output,
        **vars(options) | {"say": say, "data": data, "random": random},
    )
    write_report(json_file, "study tolerance", report)
    print_tolerance(report)


def print_tolerance(report: dict) -> None:
    """The table of `tolerance_study`, and what it sums up to."""
    for note in report["notes"]:
        print(f"note: {note}")
    shares = ("tolerance", "error", "estimated_error")
    rows = [
        [
            row["scene"],
            str(row["bounces"]),
            *(f"{100 * row[name]:.2f} %" for name in shares),
            str(row["rays"]),
            f"{row['best_rays']:.0f}",
            f"{row['cost']:.2f}",
            str(round(row["truth_share"] * row["receivers"])),
        ]
        for row in report["rows"]
    ]
    columns = ["scene", "bounces", "asked", "error", "estimate", "rays", "best", "cost", "compared"]
    print_table(
        "Tolerances asked, errors measured at the receivers compared; cost: rays with trials over best", columns, rows
    )
    found = report["summary"]
    print(
        f"met: {100 * found['share_met']:.1f} % of {found['runs']} runs; cost over the best fixed rays: median "
        f"{found['median_cost']:.2f}, 95th percentile {found['cost_95']:.2f}"
    )
    for name, honest in found["estimates"].items():
        print(
            f"{name}: at least the measured error in {100 * honest['share_at_least_measured']:.1f} % of runs, "
            f"median {honest['median_ratio']:.2f} times it"
        )
    print(f"chart: {report['files']['chart']}")
