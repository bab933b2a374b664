"""The one place that starts Warp and runs kernels on all cores.

A Warp launch on the CPU occupies one core, so work is cut into chunks and launched from several Python
threads (Warp releases the interpreter lock). Chunks are disjoint: any thread count gives the same bytes.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

import torch
import warp as wp

from diffprt.kernels.cores import default_threads

_lock = threading.Lock()
_ready: set[str] = set()


def start() -> None:
    """Initializes Warp once, quietly. `wp.from_torch` fails before it."""
    with _lock:
        if "warp" not in _ready:
            wp.config.log_level = wp.LOG_ERROR
            with _no_native_stderr():
                wp.init()
            _ready.add("warp")


@contextlib.contextmanager
def _no_native_stderr() -> Iterator[None]:
    """Warp's native part prints to stderr that no CUDA driver was found; no log level reaches it."""
    sys.stderr.flush()
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


def compile_kernels(*kernels: wp.Kernel | Callable) -> None:
    """Compiles the modules of `kernels` for the CPU, from one thread: seconds when new, then cached on disk."""
    start()
    with _lock:
        for kernel in kernels:
            if kernel.module.name not in _ready:
                kernel.module.load(wp.get_device("cpu"))
                _ready.add(kernel.module.name)


def run_chunks(work: Callable[[int], object], chunks: Iterable[int], *, threads: int | None = None) -> Iterator[int]:
    """Runs `work(chunk)` for every chunk on several threads and yields each chunk as it ends.

    On an exception or Ctrl-C no further chunk is started, those in flight end, and the exception goes on.
    """
    waiting = iter(chunks)
    threads = threads or default_threads()
    with ThreadPoolExecutor(threads, thread_name_prefix="diffprt") as pool:
        running: dict[Future, int] = {}
        for chunk in waiting:
            running[pool.submit(work, chunk)] = chunk
            if len(running) < threads:
                continue
            yield from _collect(running)
        while running:
            yield from _collect(running)


def run_ranges(
    kernel: wp.Kernel, inputs: list, output: torch.Tensor, count: int, *, threads: int | None = None
) -> None:
    """Launches `kernel(*inputs, first, output)` over [0, count), one range of threads on each core."""
    target = wp.from_torch(output)
    step = max(1, -(-count // (threads or default_threads())))

    def part(first: int) -> None:
        size = min(step, count - first)
        wp.launch(kernel, size, inputs=[*inputs, first], outputs=[target], device="cpu", record_tape=False)

    for _ in run_chunks(part, range(0, count, step), threads=threads):
        pass


def _collect(running: dict[Future, int]) -> list[int]:
    """Waits for at least one chunk; raises what it raised."""
    ended, _ = wait(running, return_when=FIRST_COMPLETED)
    chunks = []
    for future in ended:
        chunks.append(running.pop(future))
        future.result()
    return chunks
