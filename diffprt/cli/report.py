"""`--json` reports and the tables that people read."""

from __future__ import annotations

import json
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

import rich.box
import typer
from rich.console import Console
from rich.table import Table

from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.whole_file import write_whole

JsonFile = typer.Option(None, "--json", metavar="FILE", help="Write timings, counts, errors and settings here.")


def check_output(path: Path, *, directory: bool = False) -> Path:
    """Makes the folder that `path` needs and proves that it can be written, before any work.

    Raises:
        InputError: it cannot.
    """
    folder = path if directory else path.parent
    if not directory and path.is_dir():
        raise InputError(f"output {path} is a folder: give the name of a file")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".diffprt-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"output folder {folder} cannot be written ({error.strerror}): choose another with -o"
        ) from error
    return path


def write_report(file: Path | None, command: str, report: dict) -> None:
    """Writes a report as JSON, whole or not at all; nothing without a file."""
    if file is None:
        return
    check_output(file)
    content = {"command": command, "machine": machine(), **report}
    write_whole(file, f"{json.dumps(content, indent=2, sort_keys=True, default=str)}\n".encode(), "report")


def machine() -> dict:
    """What the figures were measured on."""
    packages = ("diffprt", "torch", "warp-lang", "numpy", "trimesh")
    return {
        "python": platform.python_version(),
        "system": platform.system(),
        "architecture": platform.machine(),
        "threads": default_threads(),
        "versions": {name: version(name) for name in packages},
    }


def say(text: str) -> None:
    """What goes on, for people: beside what programs read."""
    print(text, file=sys.stderr, flush=True)


def print_table(title: str, columns: list[str], rows: list[list[str]]) -> None:
    """A plain table on standard output; all but the first column are right-aligned."""
    table = Table(box=rich.box.SIMPLE_HEAD)
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=100)
    console.print(title, markup=False, highlight=False, soft_wrap=True)
    console.print(table)


def size_text(count: float) -> str:
    """Bytes for people."""
    for unit in ("B", "KB", "MB", "GB"):
        if abs(count) < 1000 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.2f} {unit}"
        count /= 1000
    raise AssertionError
