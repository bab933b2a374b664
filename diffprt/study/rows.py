"""Finished rows of a study, on disk as they come: repeated, it goes on where it stopped."""

from __future__ import annotations

import json
from pathlib import Path


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
