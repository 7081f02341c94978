"""A recording in time: everything in it when it is due, apart from reading it and from what is done with it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import TypeAlias

from viewsep.errors import BadInput
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.reader import Recorded, Recording

SLOWEST, FASTEST = 0.001, 1000.0
LONGEST_WAIT_S = 3600.0  # of one call: longer ones overflow what systems can wait
Item: TypeAlias = Recorded | RecordedFrame


def in_order(recording: Recording) -> Iterator[Item]:
    """Messages in the order they were heard, each picture right before the first message heard at or after its stamp.

    That order is not strictly by stamp, and neither messages nor pictures change theirs for it. Pictures later than
    all messages come last.
    """
    frames = deque(recording.frames)
    for recorded in recording.messages:
        while frames and frames[0].stamp_ns <= recorded.stamp_ns:
            yield frames.popleft()
        yield recorded
    yield from frames


def check_pace(pace: float) -> float:
    """Raises BadInput for a pace at which nothing can be played."""
    if pace != 0.0 and not SLOWEST <= pace <= FASTEST:
        raise BadInput(
            f"pace {pace:g}: give 1 to play as recorded, 2 for twice as fast ({SLOWEST:g} to {FASTEST:g}), or 0 for as "
            "fast as possible"
        )
    return pace


class Playback:
    """Everything in a recording when it is due: iterate over it, once for every time it is to be played.

    `pace` is recorded seconds per second, 0 for as fast as possible. Whatever is late, because somebody took his time
    with the item before, comes at once, and what follows is due as if nothing had happened. Gaps are as long as they
    were. `wait` sleeps for so many seconds and returns True, at once, when it is time to stop, such as
    `threading.Event().wait` or `Ending.wait`; then the iteration ends and `stopped` is set. It is asked before every
    item. `now_ns` is a monotonic clock. Raises BadInput for a pace that is none and a recording that holds nothing.
    """

    def __init__(
        self,
        recording: Recording,
        pace: float = 1.0,
        *,
        wait: Callable[[float], bool | None] = time.sleep,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.pace = check_pace(pace)
        self.stopped = False
        self._items = tuple(in_order(recording))
        if not self._items:
            raise BadInput("the recording holds neither messages nor pictures: there is nothing to play")
        self._first_ns = self._items[0].stamp_ns
        self._last_ns = max(item.stamp_ns for item in self._items)
        self._wait = wait
        self._now_ns = now_ns
        self._place = (now_ns(), self._first_ns, self._first_ns)  # begun at, newest stamp, stamp of the next

    @property
    def stamp_ns(self) -> int:
        """Where it is now, on the clock that the recorded stamps are of; from any thread."""
        begun_ns, newest_ns, next_ns = self._place
        if self.pace == 0.0:
            return newest_ns
        return max(newest_ns, min(next_ns, self._first_ns + round((self._now_ns() - begun_ns) * self.pace)))

    @property
    def position_s(self) -> float:
        """Recorded seconds since the beginning; from any thread."""
        return (self.stamp_ns - self._first_ns) * 1e-9

    @property
    def duration_s(self) -> float:
        """Recorded seconds from the first to the last."""
        return (self._last_ns - self._first_ns) * 1e-9

    def __iter__(self) -> Iterator[Item]:
        """Play from the beginning. Ends early when `wait` says so."""
        begun_ns, newest_ns = self._now_ns(), self._first_ns
        for item in self._items:
            self._place = (begun_ns, newest_ns, item.stamp_ns)
            if self._stop_before(begun_ns, item.stamp_ns):
                return
            newest_ns = max(newest_ns, item.stamp_ns)
            self._place = (begun_ns, newest_ns, newest_ns)
            yield item

    def _stop_before(self, begun_ns: int, stamp_ns: int) -> bool:
        """Wait until what is stamped so is due; True when it is time to stop."""
        due_ns = begun_ns if self.pace == 0.0 else begun_ns + math.ceil((stamp_ns - self._first_ns) / self.pace)
        while not self.stopped:
            left_s = max(0.0, (due_ns - self._now_ns()) * 1e-9)
            self.stopped = bool(self._wait(min(left_s, LONGEST_WAIT_S)))
            if left_s == 0.0:
                break
        return self.stopped
