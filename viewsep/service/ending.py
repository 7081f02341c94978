"""Where a serving process waits for its end."""

from __future__ import annotations

import signal
from contextlib import suppress
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

    def wait(self) -> None:
        """Return when the end was asked for. Raises ViewsepError when an error was the reason."""
        while True:
            with suppress(Empty):
                error = self._asked.get(timeout=POLL_S)
                break
        if error is not None:
            raise ViewsepError(f"ended by a bug, {type(error).__name__}: {error}; the log says more") from error
