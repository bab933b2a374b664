"""Finished rows of a study, on disk as they come: repeated, it goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import torch
from safetensors.torch import save

from diffprt.errors import InputError
from diffprt.whole_file import make_folder, write_whole


def digest(options: list) -> str:
    """What a row is known by, from all that it depends on as plain values."""
    return hashlib.sha256(json.dumps(options).encode()).hexdigest()[:16]


def save_tensors(path: Path, tensors: dict[str, torch.Tensor]) -> None:
    """Keeps tensors that belong to rows; the file appears whole or not at all."""
    make_folder(path.parent)
    write_whole(path, save({name: values.contiguous() for name, values in tensors.items()}), "tensors")


def grouped(rows: Iterable[dict], *names: str) -> dict[tuple, list[dict]]:
    """Rows by what they have under `names`, groups in the order of their first rows."""
    groups: dict[tuple, list[dict]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


class Rows:
    """One JSON line for each row; a line that cannot be read is made again.

    Args:
        path: the file; rows that are in it already are read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, dict] = {}
        try:
            lines = path.read_text("utf-8", errors="replace").splitlines() if path.exists() else []
        except OSError as error:
            raise InputError(f"rows {path} cannot be read ({error.strerror}): write elsewhere") from error
        for line in lines:
            try:
                entry = json.loads(line)
                self.rows[entry["key"]] = entry["row"]
            except (ValueError, KeyError, TypeError, RecursionError):
                continue

    def add(self, key: str, row: dict) -> None:
        """Keeps a row, in memory and on disk."""
        self.rows[key] = row
        lines = (json.dumps({"key": key, "row": row}, sort_keys=True) for key, row in self.rows.items())
        write_whole(self.path, "".join(f"{line}\n" for line in lines).encode(), "rows")
