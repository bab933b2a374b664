"""One command for several inputs: a file and a report for each, a summary, and no failure that stops the others."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from diffprt.cli.mistakes import told
from diffprt.cli.outputs import STDOUT, check_ending, check_report, write_report
from diffprt.cli.tables import print_table, size_text
from diffprt.cli.terminal import one_line, print
from diffprt.errors import InputError, Interrupted

_BUILTIN = "builtin:"


@dataclass(frozen=True)
class Item:
    """One input and the file that is made of it."""

    source: str
    target: Path


def items(sources: Sequence[str], output: str, ending: str) -> list[Item]:
    """What is made of each source: the file `output` of one; in the folder `output` a file named after each of several.

    A folder is one that exists, or a name that ends in a slash; that of several sources need not say so.

    Raises:
        InputError: the output fits neither, or two sources would have the same file, which may be a source itself.
    """
    folder = Path(output)
    if len(sources) == 1 and not (output.endswith("/") or folder.is_dir()):
        check_ending(folder, ending)
        return [Item(sources[0], folder)]
    if len(sources) > 1 and folder.suffix.lower() == ending and not folder.is_dir():
        raise InputError(f"output {output} is one file, {len(sources)} are given to be made: give a folder with -o")
    made: dict[str, Item] = {}
    for source in sources:
        stem = source.removeprefix(_BUILTIN) if source.startswith(_BUILTIN) else Path(source).stem
        item = Item(source, folder / f"{stem or 'asset'}{ending}")
        # Some file systems do not tell case.
        if (other := made.setdefault(str(item.target).casefold(), item)) is not item:
            raise InputError(
                f"{other.source} and {source} would both be written to {item.target}: rename one, or give each its "
                "own folder"
            )
    return list(made.values())


def report_files(todo: Sequence[Item], reports: Path) -> list[Path]:
    """Where reports go: one file, or in a folder one of each."""
    alone = len(todo) == 1
    if reports.is_dir() or not (alone or reports.suffix):
        return [reports / f"{item.target.stem}.json" for item in todo]
    return [reports]


def run_batch(command: str, todo: list[Item], reports: Path | None, one: Callable[[Item], dict]) -> None:
    """Runs `one`, which returns its report, for each item.

    Args:
        reports: of one item the file of its report. Of several one file (.json) with all and a summary, standard
            output ("-"), or a folder with a file for each. None for none.

    Raises:
        typer.Exit: with status 1, some of several failed.
        Interrupted: Ctrl-C, once the report of what is done is written.
    """
    files = [] if reports is None else [reports] if reports == STDOUT else report_files(todo, reports)
    for file in files:
        check_report(file)
    if len(todo) == 1:
        write_report(files[0] if files else None, command, one(todo[0]))
        return
    each = dict(zip(todo, files, strict=True)) if files and files != [reports] else {}
    begun, rows = time.perf_counter(), []
    stopped: KeyboardInterrupt | None = None
    for number, item in enumerate(todo, 1):
        if stopped is not None:
            rows.append({"source": item.source, "status": "not begun", "seconds": 0.0})
            continue
        print(f"[{number}/{len(todo)}] {item.source}")
        start, row = time.perf_counter(), {"source": item.source}
        try:
            report = one(item)
            row |= {"status": "done", "report": report}
            write_report(each.get(item), command, report)
        except KeyboardInterrupt as interrupt:
            stopped = interrupt
            row |= {"status": "interrupted"}
        except Exception as error:
            message = told(error) or f"a fault of diffprt: {type(error).__name__}: {error}"
            message = message if item.source in message else f"{item.source}: {message}"
            row |= {"status": "failed", "error": message}
            print(f"diffprt: {one_line(message)}", file=sys.stderr, flush=True)
        rows.append(row | {"seconds": time.perf_counter() - start})
    _summarize(command, rows, None if each else reports, time.perf_counter() - begun)
    done = sum(row["status"] == "done" for row in rows)
    if stopped is not None:
        last = f"{stopped}; " if str(stopped) else ""
        raise Interrupted(f"{last}{done} of {len(rows)} inputs are finished and kept") from stopped
    if done < len(rows):
        raise typer.Exit(1)


def _summarize(command: str, rows: list[dict], file: Path | None, seconds: float) -> None:
    """Prints what became of each, and writes it."""
    table = []
    for row in rows:
        outputs = row.get("report", {}).get("outputs", {})
        size = size_text(outputs["bytes"]) if "bytes" in outputs else "-"
        table.append([row["source"], row["status"], size, f"{row['seconds']:.1f}"])
    counts = {"inputs": len(rows)}
    for status in ("done", "failed", "interrupted", "not begun"):
        counts[status.replace(" ", "_")] = sum(row["status"] == status for row in rows)
    title = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count)
    print_table(f"{command}: {title}, {seconds:.1f} s", ["input", "result", "file", "seconds"], table)
    write_report(file, command, {"batch": rows, "counts": counts, "timings": {"total": seconds}})
