"""What windows of a light cost in the picture, and whether "picture" chooses the best."""

from __future__ import annotations

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.paths import OutputFile
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import WindowOptions


@from_options(WindowOptions)
def run(*, options: WindowOptions, json_file: OutputFile = JsonFile) -> None:
    from diffprt.study.window import window_study

    report = window_study(**vars(options) | {"say": say})
    write_report(json_file, "study window", report)
    names = list(report["rows"][0]["errors"])
    rows = [
        [
            row["scene"],
            row["map"],
            *(f"{100 * row['errors'][name]:.2f}" for name in names),
            row["chosen"],
            f"{row['ratio']:.2f}",
        ]
        for row in report["rows"]
    ]
    print_table("Error of the picture, %", ["scene", "map", *names, "chosen", "over the best"], rows)
    print(f"picture over the best fixed window: worst {report['worst']:.2f}, {report['over']} of {len(rows)} above 1.1")
