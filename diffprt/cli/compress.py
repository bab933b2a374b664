"""Compress an asset by clustered principal component analysis."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt import asset as assets
from diffprt.cli.report import JsonFile, check_output, size_text, write_report
from diffprt.compress import compress
from diffprt.errors import InputError
from diffprt.progress import status
from diffprt.transfer import Transfer


def run(
    source: Path = typer.Argument(..., metavar="ASSET", help="A .prt file made by 'diffprt bake'."),
    output: Path = typer.Option(Path("compressed.prt"), "-o", "--output", help="The asset to write (.prt)."),
    clusters: int = typer.Option(64, help="Clusters."),
    components: int = typer.Option(8, help="Principal components per cluster."),
    method: str = typer.Option("lbg", help="lbg."),
    seed: int = typer.Option(0, help="Of the clustering's start."),
    iterations: int = typer.Option(50, help="Rounds of clustering, at most."),
    json_file: Path = JsonFile,
) -> None:
    if output.suffix != ".prt":
        raise InputError(f"output {output} has ending '{output.suffix}': give a .prt file")
    transfer = assets.load(source)
    if not isinstance(transfer, Transfer):
        raise InputError(f"asset {source} is already compressed: give the one that 'diffprt bake' made")
    report: dict = {"settings": {"clusters": clusters, "components": components, "method": method, "seed": seed}}
    check_output(output)
    with status("clustering"):
        compressed = compress(
            transfer,
            clusters=clusters,
            components=components,
            method=method,
            seed=seed,
            iterations=iterations,
            report=report,
        )
    size = assets.save(compressed, output)
    counts = report["counts"]
    if counts["clusters_dropped"]:
        print(f"note: {counts['clusters_dropped']} clusters were dropped: there are no more distinct signals")
    print(
        f"{output}: {counts['clusters']} clusters x {components} components, signal {size_text(counts['bytes'])} "
        f"(was {size_text(counts['bytes_before'])}), error {100 * report['errors']['compression_relative']:.2f} %"
    )
    report["outputs"] = {"asset": str(output), "bytes": size}
    write_report(json_file, "compress", report)
