"""What clustering costs: ours beside k-means of faiss, and the whole best method."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputName, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say
from diffprt.cli.terminal import print
from diffprt.options.study import ClusteringOptions


@from_options(ClusteringOptions)
def run(
    *,
    source: InputName = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    options: ClusteringOptions,
    output: OutputFolder = typer.Option(
        Path("out/clustering"), "-o", "--output", help="The folder that keeps the signal."
    ),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.study.clustering import clustering_study

    check_output(output, directory=True)
    report = clustering_study(source, output, **vars(options) | {"say": say})
    write_report(json_file, "study clustering", report)
    print_clustering(report)


def print_clustering(report: dict) -> None:
    """The times of `clustering_study`, and what the best method reaches."""
    for note in report["notes"]:
        print(f"note: {note}")
    settings, kmeans, best = (report[name] for name in ("settings", "kmeans", "best"))
    rows = [
        [name, *(f"{kmeans[name][key]['median']:.3g}" for key in ("cpu_seconds", "seconds", "energy"))]
        for name in ("ours", "faiss")
        if kmeans[name] is not None
    ]
    size = f"{settings['size'][0]} x {settings['size'][1]} into {settings['clusters']}"
    title = f"k-means, {size}, {settings['iterations']} iterations, medians of {settings['rounds']} rounds"
    print_table(title, ["", "CPU s", "wall s", "energy"], rows)
    if kmeans["cpu_ratio"] is not None:
        energy = kmeans["energy_ratio"]
        told = "" if energy is None else f", energy {energy['median']:.4f} times"
        print(f"ours over faiss: CPU time {kmeans['cpu_ratio']['median']:.2f} times{told}")
    columns = [best["method"], "original CPCA"]
    for name, text in (
        ("squared_error", "squared error"),
        ("overdraw", "overdraw"),
        ("overdraw_super_clusters", f"overdraw at {settings['registers']} registers"),
    ):
        if name in best:
            print(f"{text}: {best[name]:.4g} ({columns[0]}), {best['original'][name]:.4g} ({columns[1]})")
    print(f"{best['method']}: {best['seconds']:.1f} s, CPU {best['cpu_seconds']:.1f} s")
