"""A bake that has to end in time: its chunks read the clock, and take fewer rays where it runs ahead of them."""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

FEWEST_RAYS, MOST_RAYS = 32, 1 << 18
_PACKET, _STEPS_PER_OCTAVE = 16, 8
# Shares of the time: what is aimed at, when chunks are cut short, and what they are cut short to.
AIM, _LATE, _CUT = 0.85, 0.96, 0.9
# Before what remains takes less than this part of the rays that others had, the bake runs over, up to that share.
_UNEVEN, _GRACE = 0.25, 1.2
# Rays rise by two steps at least, and only while half of the work is still to come: later, too little is left to even
# them out.
_RISE, _RISING_SHARE = 1.15, 0.5
# Chunks that are held at least, and the share of the time so far, to tell the speed of late.
_TELLING, _RECENT = 4, 0.5
# What the trial said counts as much as this share of the pass would, less and less until that share of it is over.
_TRUST, _TRUSTED = 0.1, 0.4


def _ladder() -> list[int]:
    """The numbers of rays that chunks take: packets, then eight to an octave, so that few patterns are made."""
    steps = range(int(math.log2(MOST_RAYS / FEWEST_RAYS)) * _STEPS_PER_OCTAVE + 1)
    return sorted({_PACKET * int(FEWEST_RAYS * 2 ** (s / _STEPS_PER_OCTAVE) // _PACKET) for s in steps})


LADDER = _ladder()


def _on_ladder(rays: float) -> int:
    """The most rays on the ladder that are no more than these, or the fewest."""
    return LADDER[max(bisect_right(LADDER, rays) - 1, 0)]


@dataclass(frozen=True)
class Deadline:
    """When a command has to have ended.

    Attributes:
        seconds: asked for.
        begun: `time.monotonic()` at which they began.
    """

    seconds: float
    begun: float

    def until(self, share: float) -> float:
        """Seconds from now until that share of the time is over; negative after it."""
        return self.begun + share * self.seconds - time.monotonic()

    @property
    def spent(self) -> float:
        """Seconds since it began."""
        return time.monotonic() - self.begun


@dataclass(frozen=True)
class Cost:
    """What rays cost here, measured; wall clock on all threads of the bake.

    Attributes:
        side: seconds of a side of a receiver, without its rays.
        ray: seconds of a ray; above zero.
        tail: what follows a trace of so many rays per receiver, up to the end of the command [s]; never falls.
    """

    side: float
    ray: float
    tail: Callable[[int], float]

    def trace(self, sides: float, rays: int) -> float:
        """Seconds to trace so many sides."""
        return sides * (self.side + self.ray * rays)

    def whole(self, sides: float, rays: int) -> float:
        """The same, with what follows."""
        return self.trace(sides, rays) + self.tail(rays)

    def most_rays(self, sides: float, seconds: float, *, speed: float = 1.0) -> int:
        """The most rays per side whose whole takes at most `seconds` at that speed; 0 where none do."""
        fit = bisect_right(LADDER, seconds * speed, key=lambda rays: self.whole(sides, rays))
        return LADDER[fit - 1] if fit else 0

    def then(self, sides: int) -> Cost:
        """The same, where another trace of so many sides follows."""
        return replace(self, tail=lambda rays: self.whole(sides, rays))

    def affordable(self, sides: float, deadline: Deadline) -> int:
        """The most rays for which a bake that starts now is aimed to end in time, the fewest if they just fit; 0 where
        none do."""
        rays = self.most_rays(sides, deadline.until(AIM))
        return rays or (FEWEST_RAYS if self.whole(sides, FEWEST_RAYS) <= deadline.until(_LATE) else 0)

    def least(self, sides: float, deadline: Deadline) -> float:
        """Seconds that the smallest bake needs, with what is spent already."""
        return (deadline.spent + self.whole(sides, FEWEST_RAYS)) / _LATE


class Pace:
    """Rays for the chunks of a pass, found as each begins.

    Chunks lie spread over the scene in the order in which they run (see `spread`), so that where the machine turns
    slower than its trial was, what remains takes fewer rays everywhere alike.

    Args:
        deadline: when the command has to have ended.
        cost: of rays, and of what follows the pass.
        sides: of all chunks.
        rays: to begin with.
        threads: that chunks run on.
    """

    def __init__(self, deadline: Deadline, cost: Cost, sides: int, rays: int, threads: int) -> None:
        self._threads = threads
        self._deadline, self._cost, self._sides, self.rays = deadline, cost, sides, rays
        self._most, self._waiting = rays, sides
        self._expected = cost.trace(sides, rays)
        self._running: dict[int, float] = {}
        self._lock = threading.Lock()
        self._mean = 0.0
        self._done = 0.0
        self._begun = 0.0
        self._ends: deque[tuple[float, float]] = deque()

    def begin(self, chunk: int, sides: int) -> int:
        """Rays of each side of a chunk that begins now."""
        with self._lock:
            if not self._ends:
                self._begun = time.monotonic()
                self._ends.append((self._begun, 0.0))
            self._waiting -= sides
            self.rays = self._settled(sides)
            self._mean += (self.rays - self._mean) * sides / (self._sides - self._waiting)
            self._running[chunk] = self._cost.trace(sides, self.rays)
            return self.rays

    def waited(self, seconds: float) -> None:
        """A thread did not trace for so long, since a pattern of other rays was made: it says nothing of the speed."""
        with self._lock:
            idle = seconds / self._threads
            self._begun += idle
            self._ends = deque((when + idle, done) for when, done in self._ends)

    def end(self, chunk: int) -> None:
        """The chunk has ended."""
        with self._lock:
            self._done += self._running.pop(chunk)
            now = time.monotonic()
            self._ends.append((now, self._done))
            while len(self._ends) > _TELLING + 1 and self._ends[1][0] < self._begun + _RECENT * (now - self._begun):
                self._ends.popleft()

    def _settled(self, sides: int) -> int:
        """What is left, at the speed of late."""
        speed, waiting = self._speed(), self._waiting + sides
        running = sum(self._running.values()) / 2 / speed
        needed = self._cost.whole(waiting, self.rays) / speed + running
        if needed > self._deadline.until(_LATE):
            fewer = self._cost.most_rays(waiting, self._deadline.until(_CUT) - running, speed=speed)
            if fewer < _UNEVEN * self._mean:
                grace = self._cost.most_rays(waiting, self._deadline.until(_GRACE) - running, speed=speed)
                fewer = max(fewer, min(grace, _on_ladder(_UNEVEN * self._mean)))
            return min(max(fewer, FEWEST_RAYS), self.rays)
        more = self._cost.most_rays(waiting, self._deadline.until(AIM) - running, speed=speed)
        if waiting < _RISING_SHARE * self._sides:
            more = min(more, self._most)
        if more >= _RISE * self.rays:
            self._most = max(self._most, more)
            return more
        return self.rays

    def _speed(self) -> float:
        """Seconds of the model that pass in one of the clock."""
        (first, before), (last, done) = self._ends[0], self._ends[-1]
        trusted = _TRUST * max(0.0, self._expected - (last - self._begun) / _TRUSTED) + 1e-9
        return (done - before + trusted) / (last - first + trusted)


def spread(chunks: int) -> list[int]:
    """All chunks, so ordered that any first of them lie evenly among all: their numbers' bits reversed."""
    bits = max(chunks - 1, 1).bit_length()
    return [c for c in (int(f"{i:0{bits}b}"[::-1], 2) for i in range(1 << bits)) if c < chunks]
