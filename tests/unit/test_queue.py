"""The listener with a queue: order, losses, errors, an end in time."""

from __future__ import annotations

import threading

import pytest

from viewsep.messages import JointState, Message
from viewsep.recordings.queue import QueuedListener


def state(number: int) -> JointState:
    return JointState(number, (0.0,), (0.0,), False)


class Slow:
    """Hears only when it is let go; fails on the message with stamp `fails_at`."""

    def __init__(self, fails_at: int = -1) -> None:
        self.heard: list[int] = []
        self.go = threading.Event()
        self.busy = threading.Event()
        self.fails_at = fails_at

    def hear(self, stamp_ns: int, message: Message) -> None:
        self.busy.set()
        assert self.go.wait(10)
        if stamp_ns == self.fails_at:
            raise OSError("disk full")
        self.heard.append(stamp_ns)


def test_everything_is_passed_on_in_order_and_close_waits_for_it() -> None:
    inner = Slow()
    queued = QueuedListener(inner, "test")
    for number in range(500):
        queued.hear(number, state(number))
    inner.go.set()
    queued.close()
    assert inner.heard == list(range(500))
    assert (queued.lost, queued.error) == (0, None)


def test_whoever_talks_does_not_wait_and_what_does_not_fit_is_counted() -> None:
    inner = Slow()
    queued = QueuedListener(inner, "test", longest=10)
    queued.hear(0, state(0))
    assert inner.busy.wait(10)  # the first is with `inner`, ten wait
    for number in range(1, 16):
        queued.hear(number, state(number))
    assert queued.lost == 5
    inner.go.set()
    queued.close()
    assert inner.heard == list(range(11))
    assert queued.lost == 5


def test_the_first_error_is_told_and_what_follows_is_counted_as_lost() -> None:
    inner, told = Slow(fails_at=3), list[Exception]()
    queued = QueuedListener(inner, "test", told.append)
    for number in range(8):
        queued.hear(number, state(number))
    inner.go.set()
    queued.close()
    queued.hear(9, state(9))
    assert inner.heard == [0, 1, 2]
    assert [str(error) for error in told] == ["disk full"]
    assert queued.error is told[0]
    assert queued.lost == 6


def test_close_ends_in_time_when_the_other_side_hangs() -> None:
    inner = Slow()
    queued = QueuedListener(inner, "test")
    for number in range(4):
        queued.hear(number, state(number))
    assert inner.busy.wait(10)
    queued.close(timeout_s=0.1)
    assert queued.lost == 3
    inner.go.set()
    queued.close()


@pytest.mark.parametrize("times", [1, 2, 3])
def test_closing_again_is_safe_and_leaves_no_thread(times: int) -> None:
    inner = Slow()
    inner.go.set()
    before = threading.active_count()
    queued = QueuedListener(inner, "test")
    for _ in range(times):
        queued.close()
    assert threading.active_count() == before
