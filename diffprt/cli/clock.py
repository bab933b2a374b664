"""When this command began: `--seconds` count from there, start-up included."""

from __future__ import annotations

import os
import time

_IMPORTED = time.monotonic()
_begun = [_IMPORTED]


def start_clock(*, with_process: bool) -> None:
    """A command begins now, or began with the process that runs nothing else."""
    _begun[0] = _process_begun() if with_process else time.monotonic()


def command_begun() -> float:
    """`time.monotonic()` at which the command began."""
    return _begun[0]


def _process_begun() -> float:
    """At which this module was read, where the system does not tell."""
    try:
        with open("/proc/self/stat", encoding="utf-8", errors="replace") as file:
            # The name, in parentheses, may hold blanks and parentheses; the 22nd field counts ticks since the start
            # of the machine.
            ticks = int(file.read().rpartition(")")[2].split()[19])
        since_start = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return _IMPORTED
    return min(time.monotonic() - max(since_start, 0.0), _IMPORTED)
