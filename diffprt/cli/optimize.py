"""Fit an asset to reference pictures, and to the transfer that it was compressed from."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from diffprt.cli.report import JsonFile, check_output, size_text, write_report
from diffprt.errors import InputError
from diffprt.optimization import IMAGE_LOSSES, PARAMETERS, load_references, optimize
from diffprt.progress import status, track
from diffprt.representation import files as assets

_UNITS = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9}


def run(
    source: Path = typer.Argument(..., metavar="ASSET", help="A .prt file, such as 'diffprt compress' makes."),
    references: Path = typer.Option(
        ..., help="A folder with references.json, made by 'diffprt render ASSET --reference-set 32'."
    ),
    target: Path = typer.Option(None, help="The uncompressed asset: its transfer settles what pictures leave open."),
    output: Path = typer.Option(Path("optimized.prt"), "-o", "--output", help="The asset to write (.prt)."),
    parameters: str = typer.Option(None, help=f"Some of {', '.join(PARAMETERS)}, separated by commas."),
    loss: str = typer.Option(
        None, help=f"Such as 'image + 0.1*ssim'; of {', '.join(IMAGE_LOSSES)}, transfer, overdraw."
    ),
    steps: int = typer.Option(None, help="At most this many; 300 without --seconds."),
    seconds: float = typer.Option(None, help="Stop after about this long."),
    tolerance: float = typer.Option(None, help="Stop when held-out pictures have at most this relative error."),
    size: str = typer.Option(None, "--bytes", help="What the signal may take, such as 2MB: numbers are stored to fit."),
    batch: int = typer.Option(4, help="Pictures in each step."),
    learning_rate: float = typer.Option(0.05, help="Above 0, at most 1."),
    held_out: float = typer.Option(0.2, help="Share of the lights that is never trained on."),
    seed: int = typer.Option(0, help="Of batches and of what is held out."),
    checkpoint: Path = typer.Option(None, help="A file from which --resume goes on; OUTPUT.checkpoint without."),
    resume: bool = typer.Option(False, help="Go on where the same command was interrupted."),
    json_file: Path = JsonFile,
) -> None:
    if output.suffix != ".prt":
        raise InputError(f"output {output} has ending '{output.suffix}': give a .prt file")
    asset = assets.load(source)
    transfer = None if target is None else assets.load(target)
    check_output(output)
    with status("reading references"):
        pictures = load_references(references)
    report: dict = {}
    checkpoint = checkpoint or output.with_name(f"{output.name}.checkpoint")
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
        bytes=None if size is None else parse_bytes(size),
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
        f"{100 * errors['after']:.3f} % after {report['counts']['steps']} steps, signal {size_text(result.nbytes)}"
    )
    report["outputs"] = {"asset": str(output), "bytes": written}
    write_report(json_file, "optimize", report)


def parse_bytes(text: str) -> int:
    """A number of bytes, with or without KB, MB or GB (powers of 1000)."""
    found = re.fullmatch(r"\s*([0-9.]+)\s*([KMG]?B?)\s*", text.upper())
    unit = "" if found is None else found[2].removesuffix("B") + "B" if found[2] not in ("", "B") else ""
    try:
        count = round(float(found[1]) * _UNITS[unit]) if found else 0
    except ValueError:
        count = 0
    if count < 1:
        raise InputError(f"bytes is '{text}': give a size such as 500KB or 2MB")
    return count
