"""Where a process that goes on and on waits for its end."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue

from viewsep.errors import ViewsepError

POLL_S = 0.1  # a signal that the system gives to another thread does not wake the main one


class Ending:
    """The end of a process, asked for from any thread or signal handler.

    A queue whose `put` may interrupt itself: setting an Event in a signal handler can wait for itself for ever.
    """

    def __init__(self) -> None:
        self._asked: SimpleQueue[Exception | None] = SimpleQueue()

    def ask(self, error: Exception | None = None) -> None:
        """End, in good order or by an error that nobody expected."""
        self._asked.put(error)

    def on_signals(self) -> None:
        """From now on Ctrl-C and SIGTERM ask for the end. Called in the main thread."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda _number, _frame: self.ask())

    @contextmanager
    def while_on_signals(self) -> Iterator[None]:
        """The same for a while: afterwards signals do what they did before."""
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        self.on_signals()
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def wait(self, timeout_s: float = math.inf) -> bool:
        """Return True when the end was asked for, False after `timeout_s`.

        Raises ViewsepError when an error was the reason.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            left_s = deadline - time.monotonic()
            with suppress(Empty):
                error = self._asked.get(timeout=max(0.0, min(left_s, POLL_S)))
                break
            if left_s <= 0:
                return False
        if error is not None:
            raise ViewsepError(f"ended by a bug, {type(error).__name__}: {error}; the log says more") from error
        return True
