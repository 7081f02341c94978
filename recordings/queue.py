"""A listener with a thread and a bounded queue of its own, so that whoever talks to it never waits."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from viewsep.interfaces import Listener
from viewsep.messages import Message

LONGEST_QUEUE = 4096


class QueuedListener:
    """Passes on what it hears to `inner`, in order, from its own thread.

    What does not fit into the queue is not passed on and counted in `lost`. The first error of `inner` ends the
    passing on: it is kept in `error`, `on_error` is called with it from the thread, and everything after it is lost.
    """

    def __init__(
        self,
        inner: Listener,
        name: str,
        on_error: Callable[[Exception], None] = lambda _error: None,
        longest: int = LONGEST_QUEUE,
    ) -> None:
        self.lost = 0
        self.error: Exception | None = None
        self._inner = inner
        self._on_error = on_error
        self._longest = longest
        self._waiting: deque[tuple[int, Message]] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._pass_on, name=name)
        self._thread.start()

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Queue a message; never waits."""
        with self._changed:
            if self.error is not None or self._closing or len(self._waiting) >= self._longest:
                self.lost += 1
                return
            self._waiting.append((stamp_ns, message))
            self._changed.notify()

    def close(self, timeout_s: float = 10.0) -> None:
        """Pass on what is waiting and end the thread; what is left after `timeout_s` is lost. Safe to call twice."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(max(0.0, deadline - time.monotonic()))
        with self._changed:
            self.lost += len(self._waiting)
            self._waiting.clear()
        self._thread.join(max(0.1, deadline - time.monotonic()))

    def _pass_on(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._closing:
                    self._changed.wait()
                if not self._waiting:
                    return
                stamp_ns, message = self._waiting.popleft()
            try:
                self._inner.hear(stamp_ns, message)
            except Exception as error:
                with self._changed:
                    self.error = error
                    self.lost += 1 + len(self._waiting)
                    self._waiting.clear()
                self._on_error(error)
                return
