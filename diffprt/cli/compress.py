"""Compress an asset by clustered principal component analysis."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.report import JsonFile, check_output, size_text, write_report
from diffprt.compression import FORMATS, METHODS, STARTS, ClusteredSignal, compress, light_prior
from diffprt.errors import InputError
from diffprt.progress import status
from diffprt.representation import files as assets
from diffprt.scene import Environment


def run(
    source: Path = typer.Argument(..., metavar="ASSET", help="A .prt file made by 'diffprt bake'."),
    output: Path = typer.Option(Path("compressed.prt"), "-o", "--output", help="The asset to write (.prt)."),
    clusters: int = typer.Option(64, help="Clusters."),
    components: int = typer.Option(8, help="Principal components per cluster."),
    method: str = typer.Option(None, help=f"{', '.join(METHODS)}; the best one if not given."),
    coherence: float = typer.Option(
        None,
        help="How much overdraw counts, in the method's unit (the price of a triangle drawn again, in mean squared "
        "errors; alpha for lbg-coherent); chosen if not given.",
    ),
    slack: float = typer.Option(0.1, help="How far above the least error the choice of coherence may go, as a share."),
    registers: int = typer.Option(
        None, help="float4 registers of a display that draws in passes: spare triangles between passes first."
    ),
    prior: list[Path] = typer.Option(
        None, help="An environment map (repeatable): weigh errors as such lights show them."
    ),
    weights_format: str = typer.Option("float32", help=f"{', '.join(FORMATS)}, of the weights."),
    bases_format: str = typer.Option("float32", help=f"{', '.join(FORMATS)}, of means and components."),
    start: str = typer.Option("k-means++", help=f"{', '.join(STARTS)}."),
    seed: int = typer.Option(0, help="Of the clustering's start."),
    iterations: int = typer.Option(50, help="Rounds of clustering, at most."),
    json_file: Path = JsonFile,
) -> None:
    if output.suffix != ".prt":
        raise InputError(f"output {output} has ending '{output.suffix}': give a .prt file")
    transfer = assets.load(source)
    if isinstance(transfer, ClusteredSignal):
        raise InputError(f"asset {source} is already compressed: give the one that 'diffprt bake' made")
    check_output(output)
    lights = [Environment.load(path).project(transfer.order).coefficients for path in prior or []]
    report: dict = {}
    with status("clustering"):
        compressed = compress(
            transfer,
            clusters=clusters,
            components=components,
            method=method,
            coherence=coherence,
            slack=slack,
            registers=registers,
            prior=light_prior(lights) if lights else None,
            weights_format=weights_format,
            bases_format=bases_format,
            start=start,
            seed=seed,
            iterations=iterations,
            report=report,
        )
    report["settings"] = compressed.settings["compress"]
    size = assets.save(compressed, output)
    counts = report["counts"]
    if counts["clusters_dropped"]:
        print(f"note: {counts['clusters_dropped']} clusters were dropped: no receiver is best served by them")
    drawn = f", overdraw {counts['overdraw']:.3f}" if "overdraw" in counts else ""
    print(
        f"{output}: {counts['clusters']} clusters x {components} components, signal {size_text(counts['bytes'])} "
        f"(was {size_text(counts['bytes_before'])}), "
        f"error {100 * report['errors']['compression_relative']:.2f} %{drawn}"
    )
    report["outputs"] = {"asset": str(output), "bytes": size}
    write_report(json_file, "compress", report)
