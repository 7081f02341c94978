"""A clock that moves only when somebody waits: ten simulated seconds take as long as the physics needs."""

from __future__ import annotations

from collections.abc import Callable


class SimClock:
    """Monotonic simulated time. `on_advance(from_ns, to_ns)` is called for every step forward, before time is set."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns
        self.on_advance: Callable[[int, int], None] = lambda _from_ns, _to_ns: None

    def now_ns(self) -> int:
        """Simulated nanoseconds."""
        return self._now_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Let simulated time pass up to `stamp_ns`."""
        if stamp_ns > self._now_ns:
            self.on_advance(self._now_ns, stamp_ns)
            self._now_ns = stamp_ns
