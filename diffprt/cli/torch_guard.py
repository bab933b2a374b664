"""One torch thread for every command."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_THREADS = "OMP_NUM_THREADS"
# Read once, when torch is imported. "PASSIVE": whoever asks for more threads gets ones that sleep while they wait.
_SETTINGS = {_THREADS: "1", "OMP_WAIT_POLICY": "PASSIVE"}


@contextmanager
def torch_guarded() -> Iterator[None]:
    """On a busy machine torch's threads spin while they wait for each other, and a command would take twice its CPU
    time; kernels still use all cores. The environment, where it says otherwise, is obeyed.

    Sets what torch reads when it is imported, since commands import it late, and the number of threads of a torch
    that is there already.
    """
    chosen = _THREADS in os.environ
    added = {name: value for name, value in _SETTINGS.items() if name not in os.environ}
    os.environ.update(added)
    torch = None if chosen else sys.modules.get("torch")
    threads = None if torch is None else torch.get_num_threads()
    if torch is not None:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        if torch is not None:
            torch.set_num_threads(threads)
        for name in added:
            os.environ.pop(name, None)
