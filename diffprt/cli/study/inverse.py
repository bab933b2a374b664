"""Light and albedo recovered from Mitsuba's pictures and from another bake's, with noise."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.tables import print_table, say


def run(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME, of one mesh."),
    order: int = typer.Option(4, help="SH bands of light and transfer."),
    rays: int = typer.Option(4096, help="Rays per receiver."),
    views: int = typer.Option(3, help="Pictures that a light is found from."),
    albedo_views: int = typer.Option(8, help="Pictures that an albedo is found from, under each light."),
    size: int = typer.Option(192, help="Pixels a side."),
    samples: int = typer.Option(512, help="Mitsuba's samples per pixel."),
    noise: float = typer.Option(0.01, help="Added to every pixel, a share of the picture's root mean square."),
    seed: int = typer.Option(0, help="Of rays and noise."),
    json_file: Path = JsonFile,
) -> None:
    asked = {name: value for name, value in locals().items() if name not in ("source", "json_file")}
    from diffprt.study.inverse import inverse_study

    report = inverse_study(source, **asked, say=say)
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
