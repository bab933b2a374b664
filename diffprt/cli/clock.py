"""When this command began: `--seconds` count from there, start-up included."""

from __future__ import annotations

import os
import time

_IMPORTED = time.monotonic()


def process_begun() -> float:
    """`time.monotonic()` at which this process began; at which the command line was read, where that is not known."""
    try:
        with open("/proc/self/stat", encoding="utf-8", errors="replace") as file:
            # The name, in parentheses, may hold blanks and parentheses; the 22nd field counts ticks since the start
            # of the machine.
            ticks = int(file.read().rpartition(")")[2].split()[19])
        since_start = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return _IMPORTED
    return min(time.monotonic() - max(since_start, 0.0), _IMPORTED)
