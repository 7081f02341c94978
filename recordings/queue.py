"""A listener with a thread and a bounded queue of its own, so that whoever talks to it does not wait."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from viewsep.interfaces import Listener
from viewsep.messages import Frame, Message

LONGEST_QUEUE = 4096
MOST_BYTES = 64_000_000


class QueuedListener:
    """Passes on what it hears to `inner`, in order, from its own thread, and calls `idle` every `idle_s` between.

    The queue holds `longest` messages and `most_bytes` of pictures. What does not fit within `patience_s` is not
    passed on and counted in `lost`; `fullest` is how many messages have waited at most. The first error of `inner` or
    `idle` ends the passing on: it is kept in `error`, `on_error` is called with it from the thread, and everything
    after it is lost.
    """

    def __init__(
        self,
        inner: Listener,
        name: str,
        on_error: Callable[[Exception], None] = lambda _error: None,
        *,
        longest: int = LONGEST_QUEUE,
        most_bytes: int = MOST_BYTES,
        patience_s: float = 0.0,
        idle: Callable[[], None] | None = None,
        idle_s: float = 1.0,
    ) -> None:
        self.lost = 0
        self.fullest = 0
        self.error: Exception | None = None
        self._inner = inner
        self._on_error = on_error
        self._longest = longest
        self._most_bytes = most_bytes
        self._patience_s = patience_s
        self._idle = idle
        self._idle_s = idle_s if idle else None
        self._waiting: deque[tuple[int, Message]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=name)
        self._thread.start()

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Queue a message; waits for `patience_s` at most."""
        size = _bytes(message)
        with self._changed:
            if self._patience_s:
                self._changed.wait_for(lambda: self._ended or self._fits(size), self._patience_s)
            if self._ended or not self._fits(size):
                self.lost += 1
                return
            self._waiting.append((stamp_ns, message))
            self._bytes += size
            self.fullest = max(self.fullest, len(self._waiting))
            self._changed.notify_all()

    def close(self, timeout_s: float = 10.0) -> None:
        """Pass on what is waiting and end the thread; what is left after `timeout_s` is lost. Safe to call twice."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(max(0.0, deadline - time.monotonic()))
        with self._changed:
            self.lost += len(self._waiting)
            self._waiting.clear()
        self._thread.join(max(0.1, deadline - time.monotonic()))

    @property
    def _ended(self) -> bool:
        return self.error is not None or self._closing

    def _fits(self, size: int) -> bool:
        room = size == 0 or self._bytes == 0 or self._bytes + size <= self._most_bytes
        return room and len(self._waiting) < self._longest

    def _run(self) -> None:
        try:
            while self._pass_on():
                if self._idle is not None:
                    self._idle()
        except Exception as error:
            with self._changed:
                self.error = error
                self.lost += len(self._waiting)
                self._waiting.clear()
                self._changed.notify_all()
            self._on_error(error)

    def _pass_on(self) -> bool:
        """Pass on the next message, if one comes before it is time to idle; False at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closing, self._idle_s)
            if not self._waiting:
                return not self._closing
            stamp_ns, message = self._waiting.popleft()
            self._bytes -= _bytes(message)
            self._changed.notify_all()
        try:
            self._inner.hear(stamp_ns, message)
        except Exception:
            with self._changed:
                self.lost += 1
            raise
        return True


def _bytes(message: Message) -> int:
    """The size of a picture; everything else is small."""
    if not isinstance(message, Frame):
        return 0
    return int(message.image.nbytes) + (0 if message.mask is None else int(message.mask.nbytes))
