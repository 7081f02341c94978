"""Simulated time: a clock that moves only when somebody waits, and one that follows the wall."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

LONGEST_CATCH_UP_S = 1.0  # wall time that a world makes up for in one go


class SimClock:
    """Monotonic simulated time: ten seconds take as long as the physics needs.

    `on_advance(from_ns, to_ns)` is called for every step forward, before time is set. `lock` guards time and whatever
    the world remembers; it is held for short calls only, never while sleeping or rendering.
    """

    def __init__(self, start_ns: int = 0) -> None:
        self.lock = threading.RLock()
        self.on_advance: Callable[[int, int], None] = lambda _from_ns, _to_ns: None
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Simulated nanoseconds."""
        return self._now_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Let simulated time pass up to `stamp_ns`."""
        with self.lock:
            self._advance_to(stamp_ns)

    def _advance_to(self, stamp_ns: int) -> None:
        if stamp_ns > self._now_ns:
            self.on_advance(self._now_ns, stamp_ns)
            self._now_ns = stamp_ns


class PacedClock(SimClock):
    """Simulated time at `speed` times the wall's: reading it lets the world catch up first, waiting really waits.

    A world nobody has read for longer than `LONGEST_CATCH_UP_S` stood still for the rest, so that no caller has to wait
    until it has made up for an hour.
    """

    def __init__(self, speed: float, start_ns: int = 0, wall_ns: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__(start_ns)
        self.speed = speed
        self._wall_ns = wall_ns
        self._read_ns = wall_ns()
        self._owed_ns = 0.0  # fractions of a nanosecond add up

    def now_ns(self) -> int:
        """Simulated nanoseconds, when the world has caught up with the wall."""
        with self.lock:
            wall_ns = self._wall_ns()
            passed_ns = min(wall_ns - self._read_ns, round(LONGEST_CATCH_UP_S * 1e9))
            self._read_ns = wall_ns
            self._owed_ns += passed_ns * self.speed
            whole_ns = int(self._owed_ns)
            self._owed_ns -= whole_ns
            self._advance_to(self._now_ns + whole_ns)
            return self._now_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Wait until the wall has come to `stamp_ns`."""
        while (remaining_ns := stamp_ns - self.now_ns()) > 0:
            time.sleep(min(remaining_ns * 1e-9 / self.speed, LONGEST_CATCH_UP_S / 2))
