"""Light and albedo recovered from Mitsuba's pictures and from another bake's, with noise."""

from __future__ import annotations

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.paths import InputName, OutputFile
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import InverseOptions


@from_options(InverseOptions)
def run(
    source: InputName = typer.Argument(
        "builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME, of one mesh."
    ),
    json_file: OutputFile = JsonFile,
    *,
    options: InverseOptions,
) -> None:
    from diffprt.study.inverse import inverse_study

    report = inverse_study(source, **vars(options) | {"say": say})
    write_report(json_file, "study inverse", report)
    print_inverse(report)


def print_inverse(report: dict) -> None:
    """The tables of `inverse_study`."""

    def share(value: float) -> str:
        return "-" if value == float("inf") else f"{100 * value:.2f} %"

    rows = [
        [
            f"{row['scene']}, {row['light']}, {row['pictures']}",
            share(row["error"]),
            *(
                "unseen" if not seen else share(off)
                for off, seen in zip(row["band_error"], row["observable"], strict=True)
            ),
        ]
        for row in report["light"]
    ]
    bands = max(len(row["band_error"]) for row in report["light"])
    rows = [row + [""] * (bands + 2 - len(row)) for row in rows]
    views, noise = report["settings"]["views"], report["settings"]["noise"]
    title = f"Light from {views} pictures with {100 * noise:g} % noise: error overall and of each band"
    print_table(title, ["scene, light, pictures", "error", *(str(l) for l in range(bands))], rows)
    for row in report["light"]:
        gain = ", ".join(f"{value:.4f}" for value in row["gain"])
        error = ", ".join(share(value) for value in row["standard_error"])
        print(
            f"{row['scene']}, {row['light']}, {row['pictures']}: condition {row['condition']:.0f}; gain by band {gain}"
        )
        print(f"  standard error by band, of the whole light: {error}; unexplained {share(row['residual'])}")
    columns = ["light", "interreflection", "error", "red", "green", "blue", "told", "turns"]
    rows = [
        [
            row["light"],
            row["interreflection"],
            share(row["error"]),
            *(share(value) for value in row["color_error"]),
            share(row["receivers_told"]),
            str(row["turns"]),
        ]
        for row in report["albedo"]
    ]
    print_table(f"Albedo of the receivers told, from {report['settings']['albedo_views']} pictures", columns, rows)
    for row in report["joint"]:
        lights = ", ".join(share(value) for value in row["light_errors"])
        print(
            f"together, from {len(row['light_errors'])} unknown lights: albedo {share(row['error'])}, lights {lights} "
            f"(off by {share(row['mismatch'])}, next best explanation {share(row['next_best'])})"
        )
