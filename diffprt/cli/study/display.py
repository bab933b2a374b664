"""What a frame costs in a browser: clusters in one pass and in several, and uncompressed transfer."""

from __future__ import annotations

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputName, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say, size_text
from diffprt.cli.terminal import print
from diffprt.options.study import DisplayOptions


@from_options(DisplayOptions)
def run(
    *,
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    options: DisplayOptions,
    pictures: OutputFolder = typer.Option(None, help="Only takes pictures of the page, into this folder."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.study.display.pictures import display_pictures
    from diffprt.study.display.study import display_study

    if pictures is not None:
        check_output(pictures, directory=True)
        sizes = options.settings("size", "frames", "rounds")
        made = display_pictures(source, pictures, **sizes, say=say)
        write_report(json_file, "study display", {"settings": sizes, "outputs": [str(path) for path in made]})
        print(f"{pictures}: {len(made)} pictures")
        return
    report = display_study(source, **vars(options) | {"say": say})
    write_report(json_file, "study display", report)
    print_display(report)


def print_display(report: dict) -> None:
    """The rows of `display_study` and what they come to."""
    settings, counts = report["settings"], report["counts"]
    rows = [
        [
            row["way"],
            *(
                f"{row[key]['median']:.1f} ({row[key]['low']:.1f}-{row[key]['high']:.1f})"
                for key in ("still_ms", "turning_ms")
            ),
            f"{row['triangles_drawn']:,}",
            f"{row['light_products']:,}",
            size_text(row["signal_bytes"]),
        ]
        for row in report["rows"]
    ]
    columns = ["way", "still, ms", "light turning, ms", "triangles drawn", "products per light", "signal"]
    print_table(
        f"A frame of {settings['size']} x {settings['size']} pixels, {counts['triangles']:,} triangles, "
        f"{settings['clusters']} clusters x {settings['components']} components, software rendering",
        columns,
        rows,
    )
    print(f"{counts['passes']} passes of {settings['registers']} registers, overdraw {counts['overdraw']:.3f}")
    for name, ratio in report["ratios"].items():
        print(f"{name}: {ratio['still']['median']:.2f} of one pass at rest, {ratio['turning']['median']:.2f} turning")
