"""A bake of direct light alone, trained towards path-traced pictures."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.parsing import parse_clusters
from diffprt.cli.paths import InputFile, InputName, OutputFile, OutputFolder
from diffprt.cli.terminal import print


def run(
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="The scene of the references."),
    folder: InputFile = typer.Option(..., "--references", help="A folder made by 'diffprt study references'."),
    size: str = typer.Option("64x8", help="CLUSTERSxCOMPONENTS."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    steps: int = typer.Option(100, help="Of training."),
    output: OutputFolder = typer.Option(Path("out/unseen"), "-o", "--output", help="The folder for the sheet."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.optimization import load_references
    from diffprt.study.optimization.unseen import unseen_study

    check_output(output, directory=True)
    made = load_references(folder)
    clusters, components = parse_clusters(size)
    options = {"clusters": clusters, "components": components, "order": made.order, "rays": rays, "steps": steps}
    report = unseen_study(source, made, output, **options)
    write_report(json_file, "study unseen", report)
    before, after = (100 * report["errors"][name] for name in ("before", "after"))
    print(f"error of held-out pictures: {before:.2f} % before, {after:.2f} % after")
    print(f"picture: {report['files']['sheet']}")
