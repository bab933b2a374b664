"""Finished rows of a study, on disk as they come: repeated, it goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import torch
from safetensors.torch import save_file


def digest(options: list) -> str:
    """What a row is known by, from all that it depends on as plain values."""
    return hashlib.sha256(json.dumps(options).encode()).hexdigest()[:16]


def save_tensors(path: Path, tensors: dict[str, torch.Tensor]) -> None:
    """Keeps tensors that belong to rows; the file appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    save_file({name: values.contiguous() for name, values in tensors.items()}, partial)
    partial.replace(path)


def grouped(rows: Iterable[dict], *names: str) -> dict[tuple, list[dict]]:
    """Rows by what they have under `names`, groups in the order of their first rows."""
    groups: dict[tuple, list[dict]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


class Rows:
    """One JSON line for each row; a line cut off by a kill is made again.

    Args:
        path: the file; rows that are in it already are read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, dict] = {}
        lines = path.read_text("utf-8").splitlines() if path.exists() else []
        for line in lines:
            try:
                entry = json.loads(line)
                self.rows[entry["key"]] = entry["row"]
            except (ValueError, KeyError, TypeError):
                continue

    def add(self, key: str, row: dict) -> None:
        """Keeps a row, in memory and on disk."""
        self.rows[key] = row
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "row": row}, sort_keys=True) + "\n")
