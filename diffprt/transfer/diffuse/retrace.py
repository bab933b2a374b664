"""The bounce operator where memory does not hold it: its rows are traced again for every product."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing

import torch

from diffprt.kernels import run_chunks
from diffprt.surface.operator import BounceOperator, OperatorRows, StoredOperator
from diffprt.transfer.diffuse.tracing import Tracers, Tracing

# Rays whose hits are held at a time, over all threads.
RAYS_PER_BLOCK = 1 << 22


class RetracedOperator(BounceOperator):
    """G, some receivers at a time: traced, multiplied, dropped. Products equal those of `StoredOperator`.

    Args:
        tracing: whose chunks are traced again.
        rays: int64 [rows], which it traced.
        threads: CPU threads.
    """

    def __init__(self, tracing: Tracing, rays: torch.Tensor, threads: int) -> None:
        self.receivers, self.sources, self.entries = len(tracing.order), len(tracing.surfaces.receivers), 0
        self._tracing, self._rays, self._threads = tracing, rays, threads
        self._tracers = Tracers(tracing, 0, hits=True)

    def product(self, dense: torch.Tensor) -> torch.Tensor:
        result = dense.new_empty(self.receivers, dense.shape[1])
        for rows, block in self._blocks():
            result[rows] = block.product(dense)
        return result

    def transposed(self) -> Callable[[torch.Tensor], torch.Tensor]:
        return self._transposed_product

    def _transposed_product(self, dense: torch.Tensor) -> torch.Tensor:
        result = dense.new_zeros(self.sources, dense.shape[1])
        for rows, block in self._blocks():
            result += block.transposed()(dense[rows])
        return result

    def _blocks(self) -> Iterator[tuple[torch.Tensor, StoredOperator]]:
        """Some receivers and their rows of G, in order: sums do not depend on which thread is first."""
        cut = self._tracing.cut
        # Receivers at a time whose hits are held.
        step = max(1, RAYS_PER_BLOCK // (len(cut[0]) * int(self._rays.max())))
        for first in range(0, len(cut), step):
            chunks = range(first, min(first + step, len(cut)))
            parts: dict[int, OperatorRows] = {}

            def work(chunk: int, parts: dict[int, OperatorRows] = parts) -> None:
                parts[chunk] = self._tracers.rows(chunk, int(self._rays[cut[chunk].start]))

            with closing(run_chunks(work, chunks, threads=self._threads)) as running:
                for _ in running:
                    pass
            rows = self._tracing.order[cut[chunks[0]].start : cut[chunks[-1]].stop]
            yield rows, StoredOperator([parts[chunk] for chunk in chunks], self.sources)
