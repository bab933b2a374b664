"""A run's state on disk: one file that appears whole or not at all."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import safetensors
import safetensors.torch
import torch

from diffprt.errors import InputError
from diffprt.whole_file import write_whole

_KEY = "diffprt optimize"
_VERSION = 1


def fingerprint(tensors: list[torch.Tensor], settings: dict) -> str:
    """SHA-256 of what a run depends on: a checkpoint of another run is refused."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode())
    for tensor in tensors:
        digest.update(str(tuple(tensor.shape)).encode())
        digest.update(tensor.detach().contiguous().numpy().tobytes())
    return digest.hexdigest()


def write_checkpoint(path: Path, run: str, tensors: dict[str, torch.Tensor], progress: dict) -> None:
    """Writes tensors and plain values.

    Args:
        run: `fingerprint` of the run.

    Raises:
        InputError: the file cannot be written.
    """
    header = json.dumps({"version": _VERSION, "run": run, "progress": progress}, sort_keys=True)
    data = safetensors.torch.save({name: t.contiguous() for name, t in tensors.items()}, metadata={_KEY: header})
    write_whole(path, data, "checkpoint")


def read_checkpoint(path: Path, run: str) -> tuple[dict[str, torch.Tensor], dict]:
    """Tensors and plain values of the run `run`.

    Raises:
        InputError: the file is missing, damaged, or of another run.
    """
    if not path.is_file():
        raise InputError(f"checkpoint {path} does not exist: leave resume out to start anew")
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {})[_KEY])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        version, found, progress = header["version"], header["run"], header["progress"]
    except (safetensors.SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"checkpoint {path} is damaged or not one: delete it and start anew") from error
    if version != _VERSION or found != run:
        raise InputError(
            f"checkpoint {path} is of a run with another asset, references, loss or settings: repeat that command, or "
            "delete the file"
        )
    return tensors, progress
