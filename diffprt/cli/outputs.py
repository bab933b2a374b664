"""What commands write: files that can be written before any work, and `--json` reports."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import typer

from diffprt.cli.held import hold_output
from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.lock import lock_file
from diffprt.whole_file import write_whole

JsonFile = typer.Option(None, "--json", metavar="FILE", help="Write timings, counts, errors and settings here.")


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
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".diffprt-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"output folder {folder} cannot be written ({error.strerror}): choose another with -o"
        ) from error
    if hold:
        hold_output(path, folder / ".diffprt.lock" if directory else lock_file(path))
    return path


def write_report(file: Path | None, command: str, report: dict) -> None:
    """Writes a report as JSON, whole or not at all; nothing without a file."""
    if file is None:
        return
    check_output(file, hold=False)
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
