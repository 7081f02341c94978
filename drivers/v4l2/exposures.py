"""Counts exposures by their time stamps: OpenCV does not hand on the driver's own count."""

from __future__ import annotations

from collections import deque

import numpy as np

REMEMBERED = 31
ENOUGH = 4
SHARE = 25  # percentile of the intervals that is taken for the period: those with a drop in them are longer


class Exposures:
    """Numbers exposures from 0 on, so that a gap in the stamps is a gap in the numbers.

    The period is what most stamps say, and at first `period_ns`: a camera may be slower than it promised, e.g. with a
    long exposure. Where every second frame is lost from the beginning on, stamps cannot tell that from a slow camera.
    """

    def __init__(self, period_ns: int) -> None:
        self._nominal_ns = period_ns
        self._intervals_ns: deque[int] = deque(maxlen=REMEMBERED)
        self._last_ns: int | None = None
        self._number = -1

    @property
    def period_ns(self) -> int:
        """Between two exposures."""
        if len(self._intervals_ns) < ENOUGH:
            return self._nominal_ns
        return round(float(np.percentile(self._intervals_ns, SHARE)))

    def number(self, stamp_ns: int) -> int:
        """Of the exposure at `stamp_ns`, which is later than those before."""
        if self._last_ns is None:
            self._number += 1
        else:
            interval_ns = stamp_ns - self._last_ns
            self._number += max(1, round(interval_ns / self.period_ns))
            self.learn(interval_ns)
        self._last_ns = stamp_ns
        return self._number

    def learn(self, interval_ns: int) -> None:
        """Two exposures followed each other, perhaps with lost ones between them."""
        self._intervals_ns.append(interval_ns)

    def restart(self) -> None:
        """The camera was opened anew: what it did not expose meanwhile is not counted."""
        self._last_ns = None
