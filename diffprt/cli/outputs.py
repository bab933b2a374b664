"""What commands write: files that can be written before any work, and `--json` reports."""

from __future__ import annotations

import json
import math
import platform
from importlib.metadata import version
from pathlib import Path

import typer

from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.partial_files import partial_name
from diffprt.whole_file import write_whole

JsonFile = typer.Option(None, "--json", metavar="FILE", help="Write timings, counts, errors and settings here.")


def check_ending(path: Path, *endings: str) -> None:
    """Refuses a file of another ending."""
    if path.suffix.lower() not in endings:
        raise InputError(f"output {path} has ending '{path.suffix}': give a {' or '.join(endings)} file")


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
        probe = folder / partial_name("probe")
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"output folder {folder} cannot be written ({error.strerror}): choose another with -o"
        ) from error
    return path


def write_report(file: Path | None, command: str, report: dict) -> None:
    """Writes a report as JSON, whole or not at all, numbers that are not finite as null; nothing without a file."""
    if file is None:
        return
    check_output(file)
    content = _finite({"command": command, "machine": machine(), **report})
    text = json.dumps(content, indent=2, sort_keys=True, default=str, allow_nan=False)
    write_whole(file, f"{text}\n".encode(), "report")


def _finite(value: object) -> object:
    """As JSON can hold it: null in place of a number that is not finite."""
    if isinstance(value, dict):
        return {key: _finite(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(held) for held in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
