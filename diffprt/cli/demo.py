"""Bake, compress, render and export an embedded bunny; say where the pictures and the page are."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import OutputFile, OutputFolder
from diffprt.cli.tables import print_table, size_text
from diffprt.cli.terminal import print
from diffprt.progress import track


def run(
    output: OutputFolder = typer.Option(Path("demo"), "-o", "--output", help="The folder to write into."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(2, help="Diffuse interreflections."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.demo import run_demo

    check_output(output, directory=True)
    result = run_demo(
        output,
        order=order,
        rays=rays,
        bounces=bounces,
        track=track,
        stage_begins=lambda name: print(f"... {name}", flush=True),
    )
    total = sum(result.stages.values())
    rows = [[name, f"{seconds:.2f}", f"{100 * seconds / total:.0f} %"] for name, seconds in result.stages.items()]
    counts, errors = result.counts, result.errors
    print_table(
        f"bunny and ground: {counts['triangles']:,} triangles, {counts['receivers']:,} receivers, "
        f"{counts['rays'] / 1e6:.1f} M rays, order {order}, {bounces} bounces",
        ["stage", "seconds", "share"],
        [*rows, ["total", f"{total:.2f}", ""]],
    )
    print(
        f"signal compressed from {size_text(counts['bytes_baked'])} to {size_text(counts['bytes_compressed'])}, "
        f"transfer error {100 * errors['compression_relative']:.2f} %, "
        f"picture {errors['compressed_psnr_db']:.1f} dB PSNR"
    )
    print(f"contact sheet: {result.sheet}")
    print(f"page:          {result.page}  ({size_text(counts['bytes_page'])}, open it in a browser)")
    report = {"timings": {**result.stages, "total": total}, "counts": counts, "errors": errors}
    write_report(json_file, "demo", {**report, "outputs": {"sheet": str(result.sheet), "page": str(result.page)}})
