"""Who may move the rig: one holder at a time, as long as it is heard from."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from viewsep.errors import LeaseLost
from viewsep.service.requests import Code, Refused


class Lease:
    """One holder, named by a string that nobody else uses, for any number of threads.

    A holder that is silent for `lease_s` has lapsed: whoever watches stops the motion, another one may take the lease,
    and the holder may go on if nobody has. `clock` gives seconds.
    """

    def __init__(self, lease_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.lease_s = lease_s
        self._clock = clock
        self._lock = threading.Lock()
        self._holder = ""
        self._heard_s = 0.0
        self._lost: tuple[str, str] = ("", "")  # who lost it last, and why

    @property
    def holder(self) -> str:
        """The present holder, lapsed or not; empty when there is none."""
        return self._holder

    def acquire(self, holder: str) -> bool:
        """Take the lease; True when whoever had it, this holder or another, had lapsed. Raises Refused (busy)."""
        with self._lock:
            had_lapsed, taken_over = self._lapsed(), self._holder not in ("", holder)
            if taken_over and not had_lapsed:
                raise Refused(Code.BUSY, f"the rig is moved by {self._holder}: wait until it is done, or stop it")
            if taken_over:
                reason = f"{holder} has taken the rig after {self.lease_s:g} s of silence"
                self._lost = self._holder, reason
            elif self._lost[0] == holder:
                self._lost = "", ""
            self._holder, self._heard_s = holder, self._clock()
            return had_lapsed

    def renew(self, holder: str) -> bool:
        """The holder is still there; True when it had lapsed. Raises LeaseLost when it no longer holds the lease."""
        with self._lock:
            if holder != self._holder or not holder:
                loser, reason = self._lost
                raise LeaseLost(reason if holder == loser and holder else f"{holder or 'nobody'} does not hold the rig")
            had_lapsed = self._lapsed()
            self._heard_s = self._clock()
            return had_lapsed

    def lapse(self, holder: str) -> None:
        """`holder` cannot be heard any more: it has lapsed now, not only after `lease_s`."""
        with self._lock:
            if holder == self._holder:
                self._heard_s = -math.inf

    def release(self, holder: str) -> bool:
        """Give the lease back; False when `holder` did not hold it."""
        with self._lock:
            held = self._holder == holder != ""
            if held:
                self._holder = ""
            return held

    def revoke(self, reason: str) -> None:
        """Take the lease away; the holder's next call says `reason`, a sentence, and anybody may acquire it."""
        with self._lock:
            if self._holder:
                self._lost = self._holder, reason
                self._holder = ""

    def lapsed(self) -> bool:
        """Whether there is a holder that was silent for too long."""
        with self._lock:
            return self._lapsed()

    def _lapsed(self) -> bool:
        return self._holder != "" and self._clock() - self._heard_s >= self.lease_s
