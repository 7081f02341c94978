"""What every camera keeps, whatever takes the pictures. `test_camera.py` lists the implementations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from viewsep.errors import NotConnected, Timeout
from viewsep.interfaces import CameraSource, Clock
from viewsep.messages import Frame

SECOND_NS = 1_000_000_000
FRAMES = 20


@dataclass(frozen=True)
class CameraCase:
    """A camera that was constructed and nothing else. `timeout_s` is plenty for a frame to arrive."""

    camera: CameraSource
    clock: Clock
    timeout_s: float = 2.0


class CameraContract:
    """Subclass as `Test…` with a fixture `case` that gives a CameraCase of each implementation."""

    def test_nothing_is_delivered_before_connecting(self, case: CameraCase) -> None:
        with pytest.raises(NotConnected, match="connect"):
            case.camera.read(0, case.timeout_s)
        assert case.camera.drops == 0

    def test_nothing_is_delivered_after_closing_and_closing_twice_is_safe(self, case: CameraCase) -> None:
        with connected(case):
            pass
        case.camera.close()
        with pytest.raises(NotConnected, match="connect"):
            case.camera.read(0, case.timeout_s)

    def test_closing_what_was_never_connected_is_safe(self, case: CameraCase) -> None:
        case.camera.close()
        case.camera.close()

    def test_frames_are_colour_pictures_with_a_mask_of_their_size(self, case: CameraCase) -> None:
        with connected(case):
            frame = case.camera.read(case.clock.now_ns(), case.timeout_s)
        assert frame.image.dtype == np.uint8
        assert frame.image.ndim == 3
        assert frame.image.shape[2] == 3
        if frame.mask is not None:
            assert frame.mask.dtype == np.bool_
            assert frame.mask.shape == frame.image.shape[:2]

    def test_a_frame_is_exposed_after_the_moment_asked_for_and_before_it_is_delivered(self, case: CameraCase) -> None:
        with connected(case):
            for wait_ns in (0, SECOND_NS // 7, SECOND_NS // 3):
                asked_ns = case.clock.now_ns() + wait_ns
                frame = case.camera.read(asked_ns, case.timeout_s)
                assert asked_ns < frame.stamp_ns <= case.clock.now_ns()

    def test_stamps_and_sequence_numbers_only_go_up(self, case: CameraCase) -> None:
        with connected(case):
            frames = successive(case, FRAMES)
        assert (np.diff([frame.stamp_ns for frame in frames]) > 0).all()
        assert (np.diff([frame.sequence for frame in frames]) > 0).all()
        assert frames[0].sequence >= 0

    def test_sequence_numbers_count_exposures(self, case: CameraCase) -> None:
        with connected(case):
            frames = successive(case, FRAMES)
        period_ns = np.diff([frame.stamp_ns for frame in frames]) / np.diff([frame.sequence for frame in frames])
        np.testing.assert_allclose(period_ns, np.median(period_ns), rtol=0.3)

    def test_drops_are_the_gaps_in_the_sequence(self, case: CameraCase) -> None:
        with connected(case):
            first = case.camera.read(case.clock.now_ns(), case.timeout_s)
            before = case.camera.drops
            frames = [first, *successive(case, FRAMES, first.stamp_ns)]
            gaps = np.diff([frame.sequence for frame in frames]) - 1
            assert case.camera.drops - before == gaps.sum()

    def test_frames_nobody_asked_for_are_not_drops(self, case: CameraCase) -> None:
        with connected(case):
            exposures = case.camera.read(case.clock.now_ns(), case.timeout_s).sequence
            case.clock.sleep_until(case.clock.now_ns() + SECOND_NS // 2)
            exposures = case.camera.read(case.clock.now_ns(), case.timeout_s).sequence - exposures
            assert exposures > 3
            assert 0 <= case.camera.drops < exposures / 2

    def test_the_wait_for_a_frame_ends_at_its_deadline(self, case: CameraCase) -> None:
        with connected(case):
            start_ns = case.clock.now_ns()
            with pytest.raises(Timeout, match=r"no frame within 0\.2 s"):
                case.camera.read(start_ns + 60 * SECOND_NS, 0.2)
            assert 0.2 * SECOND_NS <= case.clock.now_ns() - start_ns < 0.4 * SECOND_NS
            assert case.camera.read(case.clock.now_ns(), case.timeout_s).stamp_ns > start_ns  # and goes on

    def test_frames_are_not_written_to_afterwards(self, case: CameraCase) -> None:
        with connected(case):
            frame = case.camera.read(case.clock.now_ns(), case.timeout_s)
            image, mask = frame.image.tobytes(), None if frame.mask is None else frame.mask.tobytes()
            successive(case, 5)
        assert frame.image.tobytes() == image
        assert (None if frame.mask is None else frame.mask.tobytes()) == mask


@contextmanager
def connected(case: CameraCase) -> Iterator[None]:
    case.camera.connect()
    try:
        yield
    finally:
        case.camera.close()


def successive(case: CameraCase, count: int, newer_than_ns: int | None = None) -> list[Frame]:
    """Every frame that arrives from now on."""
    frames: list[Frame] = []
    newest_ns = case.clock.now_ns() if newer_than_ns is None else newer_than_ns
    for _ in range(count):
        frames.append(case.camera.read(newest_ns, case.timeout_s))
        newest_ns = frames[-1].stamp_ns
    return frames
