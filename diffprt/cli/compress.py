"""Compress an asset by clustered principal component analysis."""

from __future__ import annotations

import typer

from diffprt.cli.batch import Item, items, run_batch
from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import BatchJson, check_output
from diffprt.cli.parsing import parse_budget
from diffprt.cli.paths import InputFiles, InputNames, OutputAssets, OutputReports
from diffprt.cli.tables import geometry_text, size_text
from diffprt.cli.terminal import print
from diffprt.errors import InputError
from diffprt.options.compress import CompressOptions
from diffprt.progress import status


@from_options(CompressOptions, bytes=parse_budget)
def run(
    source: InputNames = typer.Argument(
        ...,
        metavar="ASSET...",
        help="A .prt file made by 'diffprt bake'; of several, a failure does not stop the others.",
    ),
    output: OutputAssets = typer.Option(
        "compressed.prt", "-o", "--output", help="The asset to write (.prt); for several the folder for one of each."
    ),
    prior: InputFiles = typer.Option(
        None, help="An environment map (repeatable): weigh errors as such lights show them."
    ),
    reports: OutputReports = BatchJson,
    *,
    options: CompressOptions,
) -> None:
    from diffprt.compression import compress, light_prior
    from diffprt.representation import files as assets
    from diffprt.scene import Environment

    todo = items(source, output, ".prt")

    def one(item: Item) -> dict:
        transfer = assets.load(item.source)
        if transfer.compressed:
            raise InputError(f"asset {item.source} is already compressed: give the one that 'diffprt bake' made")
        output = check_output(item.target)
        lights = [Environment.load(path).project(transfer.order).coefficients for path in prior or []]
        report: dict = {}
        asked = vars(options) | {"prior": light_prior(lights) if lights else None, "report": report}
        with status("clustering"):
            compressed = compress(transfer, **asked)
        report["settings"] = compressed.settings["compress"]
        size = assets.save(compressed, output)
        counts = report["counts"]
        if counts["clusters_dropped"]:
            print(f"note: {counts['clusters_dropped']} clusters were dropped: no receiver is best served by them")
        drawn = f", overdraw {counts['overdraw']:.3f}" if "overdraw" in counts else ""
        print(
            f"{output}: file {size_text(size)}, "
            f"signal {size_text(counts['bytes'])} (was {size_text(counts['bytes_before'])}), "
            f"{counts['clusters']} clusters x {counts['components']} components, "
            f"error {100 * report['errors']['compression_relative']:.2f} %{drawn}"
        )
        if options.bytes is not None:
            print(f"chosen: {_chosen(report['form'], compressed.certificate)}")
        elif report["form"]["geometry"] == 16:
            print(f"geometry: {geometry_text(compressed.certificate)}")
        for warning in report["warnings"]:
            print(f"warning: {warning}")
        report["outputs"] = {"asset": str(output), "bytes": size}
        return report

    run_batch("compress", todo, reports, one)


def _chosen(form: dict, certificate: dict) -> str:
    """What a budget was spent on, in words."""
    formats = f"weights in {form['weights_format']}, bases in {form['bases_format']}"
    geometry = geometry_text(certificate) if form["geometry"] == 16 else "geometry in 32 bits"
    names = " and ".join(name.replace("_", " ") for name in reversed(form["dropped"]))
    return f"{formats}, {geometry}" + (f", without {names}" if names else "")
