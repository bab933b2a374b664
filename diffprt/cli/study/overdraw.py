"""The 2005 thesis's tables 5.1 to 5.17 for any mesh: squared error and overdraw, its methods and ours."""

from __future__ import annotations

from pathlib import Path

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import JsonFile, check_output, write_report
from diffprt.cli.paths import InputNames, OutputFile, OutputFolder
from diffprt.cli.tables import print_table, say, size_text
from diffprt.cli.terminal import print
from diffprt.options.study import OverdrawOptions
from diffprt.study.overdraw.thesis_tables import thesis_table


@from_options(OverdrawOptions)
def run(
    *,
    source: InputNames = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny]"
    ),
    options: OverdrawOptions,
    output: OutputFolder = typer.Option(Path("out/overdraw"), "-o", "--output", help="The folder; its rows are kept."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.study.overdraw.study import overdraw_study

    check_output(output, directory=True)
    report = overdraw_study(source or ["builtin:bunny"], output, **vars(options) | {"say": say})
    write_report(json_file, "study overdraw", report)
    print_overdraw(report)


def print_overdraw(report: dict) -> None:
    """The tables of `overdraw_study`, each beside the thesis's own, with verdicts and trends below."""
    from diffprt.study.overdraw.summary import SIGNAL
    from diffprt.study.rows import grouped

    for note in report["notes"]:
        print(f"note: {note}")
    verdicts = grouped(report["summary"]["groups"], *SIGNAL)
    for key, rows in sorted(grouped(report["rows"], *SIGNAL).items()):
        _print_overdraw_rows(rows)
        for verdict in verdicts.get(key, ()):
            _print_overdraw_verdict(verdict)
    for budget, found in report["summary"]["met"].items():
        if found["of"]:
            alone = "clusters alone" if budget == "clusters" else f"{budget} registers"
            print(f"less error and less overdraw with {alone}: on {found['better']} of {found['of']} signals")
    for path in [*report["files"]["charts"], *report["files"]["pictures"]]:
        print(f"picture: {path}")


def _print_overdraw_rows(rows: list[dict]) -> None:
    some = rows[0]
    budgets = sorted((b for b, found in some["super_clusters"].items() if found is not None), key=int)
    least = min((row["squared_error"] for row in rows if row["method"] == "lbg"), default=None)
    names = [row["method"] + (f" #{row['seed']}" if row["seed"] else "") for row in rows]
    table = [
        [
            name,
            f"{row['cpu_seconds']:.0f}",
            f"{row['overdraw']:.3f}",
            f"{row['squared_error']:.4g}",
            f"{row['squared_error'] / least:.3f}" if least else "-",
            "-" if row["image_error"] is None else f"{100 * row['image_error']:.2f} %",
            size_text(row["bytes"]),
        ]
        for name, row in zip(names, rows, strict=True)
    ]
    printed = thesis_table(some["scene"], some["brdf"], some["clusters"])
    lines = printed.rows if printed else []
    for line in lines:
        share = line.squared_error / lines[0].squared_error
        cells = [f"{line.seconds}", f"{line.overdraw:.3f}", f"{line.squared_error:.4g}", f"{share:.3f}", "-", "-"]
        table.append([f"thesis: {line.method}", *cells])
    channels = ", RGB" if some["channels"] == 3 else ""
    beside = f", beside the thesis's table 5.{printed.number}" if printed else ""
    columns = ["method", "CPU s", "overdraw", "error", "over original", "image", "signal"]
    print_table(f"{some['scene']}, {some['brdf']}{channels}, {some['clusters']} clusters{beside}", columns, table)
    table = [
        [name, *(f"{row['super_clusters'][b][way]['overdraw']:.3f}" for b in budgets for way in ("greedy", "search"))]
        for name, row in zip(names, rows, strict=True)
    ]
    passes = ", ".join(f"{some['super_clusters'][b]['search']['passes']} at {b}" for b in budgets)
    columns = ["method", *(name for b in budgets for name in (b, "search"))]
    print_table(f"Overdraw of super-clusters by figure 4.6 and by search; passes: {passes} registers", columns, table)


def _print_overdraw_verdict(verdict: dict) -> None:
    fair = verdict["fair"]
    if fair["ratio"] is not None:
        word = "fair" if fair["fair"] else "not fair"
        print(f"original: worst of {fair['starts']} starts has {fair['ratio']:.4f} times the energy of faiss, {word}")
    for budget, best in verdict["best"].items():
        if best["better"] is None:
            continue
        alone = "clusters alone" if budget == "clusters" else f"{budget} registers"
        thesis = f"thesis's least {best['thesis_overdraw']:.3f} ({best['thesis_method']})"
        ours = "none of ours has less error"
        if "method" in best:
            ours = f"ours {best['overdraw']:.3f} ({best['method']}, error x {best['squared_error_ratio']:.3f})"
        print(f"{alone}: {thesis}, {ours}: {'better' if best['better'] else 'not better'}")
    for floor in verdict["floors"]:
        print(
            f"prototype's floor at {floor['floor']['squared_error_ratio']:.2f} of the original's error: "
            f"{floor['method']} has {floor['squared_error']:.3f} times its error, {floor['overdraw']:.3f} times its "
            f"overdraw: {'beaten' if floor['beaten'] else 'not beaten'}"
        )
    target = verdict["target"]
    if target is not None and target["overdraw"] is not None:
        print(f"overdraw at 256 registers {target['overdraw']:.3f}, wanted at most {target['wanted']:g}")
    for step in verdict["thesis"]["steps"]:
        here = f"overdraw {_change(step['overdraw'])}, error {_change(step['squared_error'])}"
        printed = ""
        if step["thesis_overdraw"] is not None:
            there = f"{_change(step['thesis_overdraw'])}, {_change(step['thesis_squared_error'])}"
            printed = f" (thesis, table {verdict['thesis']['table']}: {there})"
        print(f"{step['step']}: {here}{printed}")
    print()


def _change(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f} %"
