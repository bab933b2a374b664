"""Wall and CPU time of a piece of work, and what several interleaved runs of it say."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass
class Stopwatch:
    """Adds up wall and CPU time [s] of the calls it is given; CPU time is that of all threads of the process."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0

    def time(self, work: Callable[[], object]) -> object:
        """Runs `work`, adds its time and returns what it returns."""
        begun, cpu = time.perf_counter(), time.process_time()
        result = work()
        self.cpu_seconds += time.process_time() - cpu
        self.seconds += time.perf_counter() - begun
        return result


def spread(values: list[float]) -> dict:
    """Median and quartiles of runs, and the runs."""
    low, median, high = (float(x) for x in np.quantile(values, (0.25, 0.5, 0.75)))
    return {"median": median, "low": low, "high": high, "runs": list(values)}


def paired_ratio(above: list[float], below: list[float]) -> dict:
    """Ratios within each round, so that what slows a whole round down drops out."""
    return spread([a / b for a, b in zip(above, below, strict=True)])
