"""Fit an asset to reference pictures, and to the transfer that it was compressed from."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_ending, check_output, write_report
from diffprt.cli.parsing import parse_budget
from diffprt.cli.paths import InputFile, OutputFile, OutputWithCheckpoint
from diffprt.cli.tables import geometry_text, size_text
from diffprt.cli.terminal import print
from diffprt.options import LOSSES, PARAMETERS
from diffprt.progress import status, track


def run(
    source: InputFile = typer.Argument(..., metavar="ASSET", help="A .prt file, such as 'diffprt compress' makes."),
    references: InputFile = typer.Option(
        ..., help="A folder with references.json, made by 'diffprt render ASSET --reference-set 32'."
    ),
    target: InputFile = typer.Option(
        None, help="The uncompressed asset: its transfer settles what pictures leave open."
    ),
    output: OutputWithCheckpoint = typer.Option(
        Path("optimized.prt"), "-o", "--output", help="The asset to write (.prt)."
    ),
    parameters: str = typer.Option(None, help=f"Some of {', '.join(PARAMETERS)}, separated by commas."),
    loss: str = typer.Option(None, help=f"Such as 'image + 0.1*ssim'; of {', '.join(LOSSES)}."),
    steps: int = typer.Option(None, help="At most this many; 300 without --seconds."),
    seconds: float = typer.Option(None, help="Stop after about this long."),
    tolerance: float = typer.Option(None, help="Stop when held-out pictures have at most this relative error."),
    size: str = typer.Option(None, "--bytes", help="What the file may take, such as 2MB: all is stored to fit."),
    geometry: int = typer.Option(None, help="16 or 32 bits of positions and normals; chosen with --bytes."),
    batch: int = typer.Option(4, help="Pictures in each step."),
    learning_rate: float = typer.Option(0.05, help="Above 0, at most 1."),
    held_out: float = typer.Option(0.2, help="Share of the lights that is never trained on."),
    seed: int = typer.Option(0, help="Of batches and of what is held out."),
    checkpoint: OutputFile = typer.Option(None, help="A file from which --resume goes on; OUTPUT.checkpoint without."),
    resume: bool = typer.Option(False, help="Go on where the same command was interrupted."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.optimization import load_references, optimize
    from diffprt.representation import files as assets

    check_ending(output, ".prt")
    asset = assets.load(source)
    transfer = None if target is None else assets.load(target)
    check_output(output)
    with status("reading references"):
        pictures = load_references(references)
    report: dict = {}
    checkpoint = check_output(checkpoint or output.with_name(f"{output.name}.checkpoint"), hold=False)
    names = None if parameters is None else [name.strip() for name in parameters.split(",")]
    result = optimize(
        asset,
        pictures,
        target=transfer,
        parameters=names,
        loss=loss,
        steps=steps,
        seconds=seconds,
        tolerance=tolerance,
        bytes=parse_budget(size),
        geometry=geometry,
        batch=batch,
        learning_rate=learning_rate,
        held_out=held_out,
        seed=seed,
        checkpoint=checkpoint,
        resume=resume,
        report=report,
        track=track,
    )
    written = assets.save(result, output)
    checkpoint.unlink(missing_ok=True)
    for note in report["notes"]:
        print(f"note: {note}")
    errors = report["errors"]
    print(
        f"{output}: error of {report['counts']['held_out']} held-out pictures {100 * errors['before']:.3f} % before, "
        f"{100 * errors['after']:.3f} % after {report['counts']['steps']} steps, "
        f"file {size_text(written)}, signal {size_text(result.nbytes)}"
    )
    if result.elements.bits == 16:
        print(f"geometry: {geometry_text(result.certificate)}")
    for name in report["dropped"]:
        print(f"dropped, to have the bytes asked for: {name.replace('_', ' ')}")
    report["outputs"] = {"asset": str(output), "bytes": written}
    write_report(json_file, "optimize", report)
