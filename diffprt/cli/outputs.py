"""What commands write: files that can be written before any work, and `--json` reports."""

from __future__ import annotations

import json
import math
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import typer

from diffprt.cli.held import hold_output
from diffprt.cli.terminal import write_document
from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.lock import lock_file
from diffprt.partial_files import partial_name
from diffprt.whole_file import write_whole

# Of docs/report.schema.json; raised when an entry changes its meaning or goes.
REPORT_VERSION = 1
STDOUT = Path("-")

JsonFile = typer.Option(
    None,
    "--json",
    metavar="FILE",
    help="Write timings, counts, errors and settings here; '-' for standard output, alone there.",
)

BatchJson = typer.Option(
    None,
    "--json",
    metavar="FILE",
    help="Write timings, counts, errors and settings here; '-' for standard output, alone there. Of several inputs: "
    "all in one .json file, or in a folder a file of each.",
)


def check_ending(path: Path, *endings: str) -> None:
    """Refuses a file of another ending."""
    if path.suffix.lower() not in endings:
        raise InputError(f"output {path} has ending '{path.suffix}': give a {' or '.join(endings)} file")


def check_output(path: Path, *, directory: bool = False, hold: bool = True) -> Path:
    """Makes the folder that `path` needs and proves that it can be written, before any work.

    Args:
        hold: whether the output is this command's alone until it ends (`let_go`).

    Raises:
        InputError: it cannot, or another run holds it.
    """
    folder = path if directory else path.parent
    if not directory and path.is_dir():
        raise InputError(f"output {path} is a folder: give the name of a file")
    _check_regular(path, "output")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / partial_name("probe")
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"output folder {folder} cannot be written ({error.strerror}): choose another with -o"
        ) from error
    if hold:
        hold_output(path, folder / ".diffprt.lock" if directory else lock_file(path))
    return path


def check_report(file: Path) -> None:
    """Refuses a report that could not be written, before any work; makes nothing."""
    if file == STDOUT:
        return
    _check_regular(file, "report")
    if file.is_dir():
        raise InputError(f"report {file} is a folder: give the name of a file")
    folder = next((parent for parent in file.absolute().parents if parent.exists()), Path("/"))
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(f"report {file} cannot be written below {folder}: choose another with --json")


def _check_regular(path: Path, what: str) -> None:
    """Refuses what is neither a file nor a folder: a whole file would take its place."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(
            f"{what} {path} is a device or a pipe: give the name of a file (a report goes to standard output "
            "with '--json -')"
        )


def write_report(file: Path | None, command: str, report: dict) -> None:
    """Writes a report as strict JSON, whole or not at all; nothing without a file. NaN and infinity become null."""
    if file is None:
        return
    content = {"version": REPORT_VERSION, "command": command, "machine": machine(), **report}
    text = f"{json.dumps(_strict(content), indent=2, sort_keys=True, default=str, allow_nan=False)}\n"
    if file == STDOUT:
        write_document(text)
        return
    check_output(file, hold=False)
    write_whole(file, text.encode(), "report")


def write_failure(command: str, message: str, status: int) -> None:
    """On standard output, the report of a command that ended without one."""
    write_report(STDOUT, command, {"error": {"message": message, "status": status}})


def _strict(value: Any) -> Any:
    """Numbers as JSON has them, in any depth."""
    if isinstance(value, dict):
        return {str(key): _strict(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


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
