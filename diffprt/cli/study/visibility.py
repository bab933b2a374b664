"""Rays per second, structure and exactness of visibility, beside Embree and Mitsuba."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import VisibilityOptions

_PEER_COLUMNS = ["scene", "rays", "peer", "differ", "fastest way"]


@from_options(VisibilityOptions)
def run(
    *,
    source: InputNames = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny builtin:closed_box]"
    ),
    output: OutputFolder = typer.Option(Path("out/visibility"), "-o", "--output", help="The folder for the chart."),
    options: VisibilityOptions,
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.study.visibility.study import visibility_study

    check_output(output, directory=True)
    report = visibility_study(source or ["builtin:bunny", "builtin:closed_box"], output, **vars(options) | {"say": say})
    write_report(json_file, "study visibility", report)
    print_visibility(report)


def print_visibility(report: dict) -> None:
    """The tables of `visibility_study`."""
    for note in report["notes"]:
        print(f"note: {note}")

    def median(value: dict | None, scale: float = 1.0) -> str:
        return "-" if value is None else f"{value['median'] * scale:.3g}"

    def rate(row: dict, name: str) -> str:
        return median(row["contenders"][name]["rate"], 1e-6)

    def ratio(row: dict, name: str) -> str:
        value = row["ratios"][name]
        return "-" if value is None else f"{value['median']:.2f}"

    columns = ["scene", "rays", "1 core", "embreex", "ratio", "all", "Mitsuba", "ratio", "SH adds", "all / 1"]
    rows = [
        [
            row["scene"],
            str(row["rays_per_receiver"]),
            rate(row, "ours_one_core"),
            rate(row, "embreex"),
            ratio(row, "embreex"),
            rate(row, "ours"),
            rate(row, "mitsuba"),
            ratio(row, "mitsuba"),
            f"{100 * (row['ratios']['sh']['median'] - 1):.1f} %",
            median(row["ratios"]["threads"]),
        ]
        for row in report["rows"]
    ]
    print_table(f"Visibility [million rays/s], medians of {report['settings']['runs']} runs", columns, rows)
    worst = [
        [row["scene"], str(row["rays_per_receiver"]), name, f"{entry['disagreement']:.1e}", entry["way"]]
        if entry["skipped"] is None
        else [row["scene"], str(row["rays_per_receiver"]), name, "-", f"skipped: {entry['skipped']}"]
        for row in report["rows"]
        for name, entry in row["contenders"].items()
        if name in ("embreex", "mitsuba")
    ]
    print_table("Peers: share of counts that differ, and how they were called", _PEER_COLUMNS, worst)
    for row in report["structure"]:
        against = f"skipped: {row['skipped']}" if row["ratio"] is None else f"{median(row['ratio'])} times Embree's"
        seconds = row["ours"]["seconds"]["median"]
        print(
            f"structure over {row['triangles']} triangles: {seconds:.2f} s, {against}, "
            f"{row['bytes_per_triangle']:.0f} bytes a triangle"
        )
    for row in report["escapes"]:
        found = row["skipped"] or f"{sum(v for k, v in row.items() if k.startswith('escaped'))} of 5 x {row['rays']}"
        print(f"escaped from {row['scene']}: {found}")
    for row in report["brute_force"]:
        print(
            f"brute force on {row['scene']}: of {row['rays']} rays {row['different_visibility']} differ in visibility, "
            f"{row['different_face']} in the face; {row['unexcused']} of them off every edge"
        )
    print(f"chart: {report['files']['chart']}")
