"""Resumable chunks: each finished chunk is a file that appears whole or not at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import safetensors.numpy

from diffprt.errors import InputError
from diffprt.whole_file import write_whole

_VERSION = 1


class ChunkStore:
    """Finished chunks of one job, in a folder (or in memory, without one).

    A job is known by its key; a folder left by another job is refused rather than overwritten.
    """

    def __init__(self, folder: Path | None, key: dict, chunks: int) -> None:
        self.folder = folder
        self.chunks = chunks
        self._memory: dict[int, dict[str, np.ndarray]] = {}
        if folder is not None:
            self._open(key)

    def _open(self, key: dict) -> None:
        job = self.folder / "job.json"
        text = json.dumps({**key, "chunks": self.chunks, "version": _VERSION}, sort_keys=True)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if job.exists() and job.read_text() != text:
                raise InputError(
                    f"{self.folder} holds chunks of a bake with other settings or another scene: "
                    "repeat that command to finish it, or delete the folder"
                )
            if not job.exists():
                write_whole(job, text.encode(), "chunks")
        except OSError as error:
            raise InputError(f"folder {self.folder} cannot be written ({error.strerror}): write elsewhere") from error

    def finished(self) -> list[int]:
        """Chunks that need no work; damaged files do not count."""
        if self.folder is None:
            return sorted(self._memory)
        return [chunk for chunk in range(self.chunks) if self._path(chunk).exists()]

    def in_flight(self) -> int:
        """Chunks that were begun and not finished: what an earlier run lost when it was killed."""
        if self.folder is None:
            return 0
        return sum(not self._path(int(mark.stem)).exists() for mark in self.folder.glob("*.begun"))

    def begin(self, chunk: int) -> None:
        """Marks a chunk as in flight."""
        if self.folder is not None:
            (self.folder / f"{chunk:06d}.begun").touch()

    def write(self, chunk: int, arrays: dict[str, np.ndarray]) -> None:
        """Stores a finished chunk."""
        if self.folder is None:
            self._memory[chunk] = arrays
            return
        write_whole(self._path(chunk), safetensors.numpy.save(arrays), "chunk")
        (self.folder / f"{chunk:06d}.begun").unlink(missing_ok=True)

    def read(self, chunk: int) -> dict[str, np.ndarray]:
        """A finished chunk."""
        if self.folder is None:
            return self._memory[chunk]
        return safetensors.numpy.load(self._path(chunk).read_bytes())

    def _path(self, chunk: int) -> Path:
        return self.folder / f"{chunk:06d}.safetensors"


def discard_chunks(folder: Path) -> None:
    """Removes a checkpoint folder, once the asset is safe; a folder that is not one is left alone."""
    if (folder / "job.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
