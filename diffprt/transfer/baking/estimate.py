"""What a bake will cost, and the one place that refuses what does not fit."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from diffprt.errors import InputError

# A bake of fewer rays takes minutes at most: it is not estimated unless asked.
FEW_RAYS = 1 << 28
# Bytes that a ray in flight takes: its hit, and the sorts that gather hits by what reflects.
RAY_BYTES = 200
_GIB = 2**30


@dataclass(frozen=True)
class Estimate:
    """Expected cost of a bake.

    Attributes:
        receivers, rays: counts; rays over all receivers and passes.
        seconds: wall clock on `threads` threads, without installation and kernel compilation.
        memory_bytes: peak beyond the interpreter and its libraries.
        asset_bytes: size of the saved signal and geometry.
        threads: CPU threads.
        operator_entries: entries of a diffuse bake's bounce operator.
        operator: "stored", or "recompute" where it is traced again for every product.
    """

    receivers: int
    rays: int
    seconds: float
    memory_bytes: int
    asset_bytes: int
    threads: int
    operator_entries: int = 0
    operator: str = "stored"

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)


def check_memory(needed: int, remedies: list[str]) -> None:
    """Refuses a bake of `needed` bytes that would not fit into free memory, before hours are spent on it."""
    available = available_memory()
    if needed > available:
        raise InputError(
            f"this bake needs about {needed / _GIB:.2f} GiB and {available / _GIB:.2f} GiB are free: "
            f"use {', '.join(remedies[:-1])} or {remedies[-1]}"
        )


def check_time(estimate: Estimate, hours: float, remedy: str) -> None:
    """Refuses a bake that is expected to take more than `hours`."""
    needed = estimate.seconds / 3600
    if needed > hours:
        raise InputError(
            f"this bake of {estimate.rays:.3g} rays takes about {needed:.1f} hours on {estimate.threads} threads, and "
            f"hours is {hours:g}: {remedy}, or allow it with --hours {math.ceil(needed)}"
        )


def fits(needed: int, share: float = 1.0) -> bool:
    """Whether that many bytes fit into a share of free memory."""
    return needed <= share * available_memory()


def available_memory() -> int:
    """Free memory of this machine [bytes]; unlimited where it cannot be told."""
    try:
        with open("/proc/meminfo") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 1 << 62
