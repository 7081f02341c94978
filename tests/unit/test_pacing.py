"""Everything in a recording comes in order and when it is due, late ones at once, and a stop ends any wait."""

from __future__ import annotations

import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.errors import BadInput
from viewsep.messages import DeadlinePassed
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.pacing import Item, Playback, in_order
from viewsep.recordings.reader import Recorded, Recording, read_recording

GOLDEN = Path(__file__).parents[1] / "golden" / "v1.mcap"
STAMPS = st.integers(0, 10**11)
PACES = st.sampled_from([0.001, 0.3, 1.0, 2.0, 7.5, 1000.0])


class FakeClock:
    """Time that passes only in `wait`, which oversleeps by `late_ns`; `stop_at` is the call of it that says stop."""

    def __init__(self, late_ns: int = 0, stop_at: int = -1) -> None:
        self.ns = 5_000
        self.waits: list[float] = []
        self._late_ns, self._stop_at = late_ns, stop_at

    def now_ns(self) -> int:
        return self.ns

    def wait(self, seconds: float) -> bool:
        self.waits.append(seconds)
        self.ns += round(seconds * 1e9) + (self._late_ns if seconds else 0)
        return len(self.waits) == self._stop_at


def recording(messages: list[int], frames: list[int]) -> Recording:
    """One with messages and pictures of these stamps."""
    heard = tuple(Recorded("event", stamp, DeadlinePassed(stamp), b"") for stamp in messages)
    return Recording({}, {}, heard, tuple(RecordedFrame(stamp, n, b"", None) for n, stamp in enumerate(frames)))


def played(content: Recording, pace: float, clock: FakeClock) -> Playback:
    return Playback(content, pace, wait=clock.wait, now_ns=clock.now_ns)


def stamps(items: list[Item]) -> list[tuple[str, int]]:
    return [("frame" if isinstance(item, RecordedFrame) else "message", item.stamp_ns) for item in items]


def test_a_frame_comes_right_before_the_first_message_heard_at_or_after_its_stamp() -> None:
    merged = stamps(list(in_order(recording([100, 300, 250, 400, 400], [90, 240, 260, 400, 500]))))
    assert merged == [
        ("frame", 90),
        ("message", 100),
        ("frame", 240),
        ("frame", 260),
        ("message", 300),
        ("message", 250),
        ("frame", 400),
        ("message", 400),
        ("message", 400),
        ("frame", 500),
    ]


@given(messages=st.lists(STAMPS, max_size=20), frames=st.lists(STAMPS, max_size=20).map(sorted))
def test_nothing_is_lost_and_nothing_changes_its_order(messages: list[int], frames: list[int]) -> None:
    content = recording(messages, frames)
    merged = list(in_order(content))
    assert [item for item in merged if isinstance(item, Recorded)] == list(content.messages)
    assert [item for item in merged if isinstance(item, RecordedFrame)] == list(content.frames)
    for place, item in enumerate(merged):
        if isinstance(item, RecordedFrame):
            before = [other.stamp_ns for other in merged[:place] if isinstance(other, Recorded)]
            after = next((other for other in merged[place:] if isinstance(other, Recorded)), None)
            assert all(stamp < item.stamp_ns for stamp in before)
            assert after is None or after.stamp_ns >= item.stamp_ns


@given(
    messages=st.lists(STAMPS, min_size=1, max_size=20),
    frames=st.lists(STAMPS, max_size=5).map(sorted),
    pace=PACES,
    late_ns=st.integers(0, 10**8),
    work_ns=st.lists(st.integers(0, 10**10), min_size=25, max_size=25),
)
def test_everything_comes_when_it_is_due_or_at_once_when_it_is_late(
    messages: list[int], frames: list[int], pace: float, late_ns: int, work_ns: list[int]
) -> None:
    content, clock = recording(messages, frames), FakeClock(late_ns)
    begun_ns = ready_ns = clock.ns
    first_ns = next(in_order(content)).stamp_ns
    for item, work in zip(played(content, pace, clock), work_ns, strict=False):
        exactly_ns = begun_ns + (item.stamp_ns - first_ns) / pace
        if ready_ns >= exactly_ns:
            assert clock.ns == ready_ns
        else:  # a little late, however often it was late before
            assert exactly_ns - 1 <= clock.ns <= exactly_ns + late_ns + 1
        clock.ns += work
        ready_ns = clock.ns


@given(messages=st.lists(STAMPS, min_size=1, max_size=20), frames=st.lists(STAMPS, max_size=5).map(sorted))
def test_at_pace_zero_nothing_is_waited_for(messages: list[int], frames: list[int]) -> None:
    content, clock = recording(messages, frames), FakeClock()
    assert list(played(content, 0.0, clock)) == list(in_order(content))
    assert not any(clock.waits)


@pytest.mark.parametrize(("pace", "lasts_s"), [(0.5, 35.2), (1.0, 17.6), (2.0, 8.8), (0.0, 0.0)])
def test_a_recording_lasts_as_long_as_it_did_by_the_pace(pace: float, lasts_s: float) -> None:
    clock = FakeClock(late_ns=60_000)
    playback = played(read_recording(GOLDEN), pace, clock)
    begun_ns = clock.ns
    assert len(list(playback)) == 1240 + 66
    assert (clock.ns - begun_ns) * 1e-9 == pytest.approx(lasts_s, abs=1e-4)
    assert playback.duration_s == playback.position_s == pytest.approx(17.6)


def test_long_gaps_are_kept() -> None:
    clock = FakeClock()
    begun_ns = clock.ns
    list(played(recording([0, 10**14], []), 1.0, clock))
    assert clock.ns - begun_ns == 10**14


def test_the_position_goes_on_while_it_waits_and_never_back() -> None:
    clock = FakeClock()
    positions: list[float] = []

    def wait(seconds: float) -> None:
        clock.wait(min(seconds, 1.0))
        positions.append(playback.position_s)

    content = recording([1_000, 4_000_001_000, 3_000_001_000, 6_000_001_000], [])
    playback = Playback(content, 2.0, wait=wait, now_ns=clock.now_ns)
    seen = [playback.position_s for _ in playback]
    assert seen == [0.0, 4.0, 4.0, 6.0]
    assert all(before <= after for before, after in pairwise(positions))
    assert 2.0 in positions
    assert playback.stamp_ns == 6_000_001_000


def test_it_can_be_played_again_from_the_beginning() -> None:
    clock = FakeClock()
    playback = played(recording([0, 2_000_000_000], [500_000_000]), 1.0, clock)
    first, begun_ns = list(playback), clock.ns
    assert list(playback) == first
    assert clock.ns - begun_ns == 2_000_000_000


@pytest.mark.parametrize("pace", [0.0, 1.0])
def test_a_stop_ends_it_before_the_next_item_and_for_good(pace: float) -> None:
    clock = FakeClock(stop_at=2)
    playback = played(recording([0, 10**9, 2 * 10**9], []), pace, clock)
    assert [item.stamp_ns for item in playback] == [0]
    assert playback.stopped
    assert list(playback) == []


def test_a_stop_ends_a_long_wait_at_once() -> None:
    stop = threading.Event()
    playback = Playback(recording([0, 10**15], []), wait=stop.wait)
    threading.Timer(0.05, stop.set).start()
    begun_s = time.monotonic()
    assert len(list(playback)) == 1
    assert time.monotonic() - begun_s < 5.0
    assert playback.stopped


@pytest.mark.parametrize("pace", [-1.0, 1e-9, 1e9, float("nan"), float("inf")])
def test_a_pace_that_is_none_is_refused(pace: float) -> None:
    with pytest.raises(BadInput, match=r"^pace .*: give 1 to play as recorded"):
        Playback(recording([1], []), pace)


def test_a_recording_without_anything_is_refused() -> None:
    with pytest.raises(BadInput, match="nothing to play"):
        Playback(recording([], []))
