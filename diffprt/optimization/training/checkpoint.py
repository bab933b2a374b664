"""A run's state on disk: one file that appears whole or not at all, and is read only if it is as it was written."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch

from diffprt.errors import InputError
from diffprt.sealed_tensors import DamagedError, read_sealed, seal, unsealed
from diffprt.whole_file import write_whole

_VERSION = 2


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
    write_whole(path, seal(tensors, _owner(run), json.dumps(progress, sort_keys=True)), "checkpoint")


def read_checkpoint(path: Path, run: str) -> tuple[dict[str, torch.Tensor], dict]:
    """Tensors and plain values of the run `run`.

    Raises:
        InputError: the file is missing, damaged, or of another run.
    """
    if not path.is_file():
        raise InputError(f"checkpoint {path} does not exist: leave resume out to start anew")
    try:
        owner, progress, content = read_sealed(path)
    except DamagedError as error:
        raise InputError(f"checkpoint {path} is damaged or not one: delete it and start anew") from error
    if owner != _owner(run):
        raise InputError(
            f"checkpoint {path} is of a run with another asset, references, loss or settings: repeat that command, or "
            "delete the file"
        )
    return unsealed(content), json.loads(progress)


def _owner(run: str) -> str:
    return f"optimize/{_VERSION}/{run}"
