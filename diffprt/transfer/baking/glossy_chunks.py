"""Passes of a glossy bake in chunks of receivers: on threads, and resumable where a folder keeps what is finished."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import torch

from diffprt.errors import Interrupted
from diffprt.kernels import run_chunks
from diffprt.options.bake import GlossySettings
from diffprt.progress import Track
from diffprt.transfer.baking.chunks import ChunkStore
from diffprt.transfer.baking.glossy_estimate import RAYS_PER_CHUNK, RECEIVERS_PER_CHUNK

Work = Callable[[range], dict[str, torch.Tensor]]


class ChunkedPasses:
    """Runs the shadow pass, then the bounces, over all receivers.

    The cut does not depend on the threads. All passes share one store, their chunks numbered one after the other, so
    a bake goes on in the pass in which it was stopped; the folder takes the size of the signal for each pass.

    Args:
        shape: of the signal, [V, C, K_out, K].
        settings: how many passes, and of how many rays.
        key: what the bake is known by.
        folder: where finished chunks live; None keeps the current pass in memory alone.
        gradients: whether results carry them; those in a folder cannot.
        threads, track: as in `bake_glossy`.

    Attributes:
        counts: `chunks`, `resumed_chunks` and `recomputed_in_flight`, for the report.

    Raises:
        InputError: the folder belongs to another bake or cannot be written.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        settings: GlossySettings,
        key: dict,
        folder: Path | None,
        *,
        gradients: bool,
        threads: int,
        track: Track,
    ) -> None:
        self._shape, self._gradients, self._threads, self._track = shape, gradients, threads, track
        rays = [settings.rays] + [settings.bounce_rays] * settings.bounces
        self._cuts = [_cut(shape[0], count) for count in rays]
        total = sum(map(len, self._cuts))
        self._store = None if folder is None else ChunkStore(folder, key, total)
        self._done = set() if self._store is None else set(self._store.finished())
        self.counts = {
            "chunks": total,
            "resumed_chunks": len(self._done),
            "recomputed_in_flight": 0 if self._store is None else self._store.in_flight(),
        }

    def run(self, number: int, work: Work, text: str) -> tuple[torch.Tensor, list[dict[str, torch.Tensor]]]:
        """Pass `number` (0 for shadows): `work` on every chunk that is not finished.

        Args:
            work: from rows to their "signal" [R, C, K_out, K], and whatever else a chunk is to keep.
            text: what the pass is called.

        Returns:
            the signal, float32, joined; and what else each chunk keeps, in their order.

        Raises:
            Interrupted: Ctrl-C.
        """
        cut, first = self._cuts[number], sum(map(len, self._cuts[:number]))
        parts: list[torch.Tensor] = [torch.empty(0)] * len(cut)
        beside: list[dict[str, torch.Tensor]] = [{}] * len(cut)
        whole = torch.empty(0 if self._gradients else self._shape)

        def keep(chunk: int, found: dict[str, torch.Tensor]) -> None:
            signal = found.pop("signal")
            beside[chunk] = found
            if self._gradients:
                parts[chunk] = signal
            else:
                whole[cut[chunk].start : cut[chunk].stop] = signal

        def one(chunk: int) -> None:
            if self._store is not None:
                self._store.begin(first + chunk)
            # Threads begin with gradients enabled, whatever their parent has.
            with torch.set_grad_enabled(self._gradients):
                found = work(cut[chunk])
            if self._store is not None:
                self._store.write(first + chunk, {name: part.contiguous().numpy() for name, part in found.items()})
            keep(chunk, found)

        finished = [chunk for chunk in range(len(cut)) if first + chunk in self._done]
        for chunk in finished:
            keep(chunk, {name: torch.from_numpy(part) for name, part in self._store.read(first + chunk).items()})
        missing = sorted(set(range(len(cut))) - set(finished))
        ended = len(finished)
        with (
            self._track(text, len(cut), ended) as advance,
            closing(run_chunks(one, missing, threads=self._threads)) as running,
        ):
            try:
                for _ in running:
                    ended += 1
                    advance()
            except KeyboardInterrupt:
                running.close()
                raise Interrupted(self._lost(ended, len(cut), text)) from None
        return torch.cat(parts) if self._gradients else whole, beside

    def _lost(self, ended: int, total: int, text: str) -> str:
        """What Ctrl-C leaves."""
        if self._store is None:
            kept = "and nothing is kept: repeat the command to start anew"
        else:
            ended = len(self._store.finished())
            total, text = self.counts["chunks"], "all passes"
            kept = f"and are kept in {self._store.folder}: repeat the command to go on"
        return f"interrupted: {ended} of {total} chunks of {text} were done, {kept}"


def _cut(receivers: int, rays: int) -> list[range]:
    """Runs of receivers that keep a thread busy for a moment."""
    size = max(1, min(RECEIVERS_PER_CHUNK, RAYS_PER_CHUNK // rays))
    return [range(first, min(first + size, receivers)) for first in range(0, receivers, size)]
