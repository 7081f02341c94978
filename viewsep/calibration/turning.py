"""Turning a known object before the camera, one joint both ways, to see how late and how loose everything is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from viewsep.calibration.latency import LONGEST_S, AppearanceMap, Frames, ReadBacks, Timing, timing_of
from viewsep.errors import BadInput, RigError, Timeout
from viewsep.interfaces import JointLimits
from viewsep.messages import Array, FloatArray, Frame, JointState
from viewsep.moves import move_and_wait
from viewsep.perception.boxes import around
from viewsep.perception.finder import ObjectFinder
from viewsep.session import Rig

SPAN_RAD, STOP_RAD = float(np.radians(64.0)), float(np.radians(4.0))
RUN_UP_RAD = float(np.radians(14.0))  # before the first stop: the play is taken up on the way
ARRIVED_RAD = float(np.radians(1.0))
FROM_ABOVE = 4  # every so many-th stop is approached from above, too
SWEEPS = 3  # each way
STEADY = 6  # pictures at every stop of the map
FRAME_S, FRAME_TIMEOUT_S, SWEEP_TIMEOUT_S = 0.1, 2.0, 120.0
LOOK_PX, BLUR_PX = 24, 1.0

Part = tuple[slice, slice]
"""Rows and columns of a picture."""
WHOLE: Part = (slice(None), slice(None))
MARGIN = 0.1  # around the object, share of its size: another side of it may be wider


@dataclass(slots=True)
class _Taken:
    """What was seen, in one part of the picture, and read meanwhile."""

    part: Part
    stamp_ns: list[int] = field(default_factory=list)
    feature: list[Array] = field(default_factory=list)
    stretch: list[int] = field(default_factory=list)

    def add(self, frame: Frame, stretch: int) -> None:
        self.stamp_ns.append(frame.stamp_ns)
        self.feature.append(look_of(frame, self.part))
        self.stretch.append(stretch)


class _Diary:
    """All read-backs of a rig from now on."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.states: list[JointState] = [rig.motion.read_state()]

    def keep(self, _state: JointState | None = None) -> None:
        """Read what is new; to be called more often than the motion forgets."""
        last_ns = self.states[-1].stamp_ns
        self.states += [state for state in self._rig.motion.history(last_ns) if state.stamp_ns > last_ns]


def look_of(frame: Frame, part: Part = WHOLE) -> FloatArray:
    """What a part of a picture shows as (D,) numbers that change smoothly while the object turns.

    The exposure does not count.
    """
    small = cv2.resize(frame.image[part], (LOOK_PX, LOOK_PX), interpolation=cv2.INTER_AREA)
    smooth: Array = cv2.GaussianBlur(small.astype(np.float32), (0, 0), BLUR_PX)
    return np.asarray(smooth / max(float(smooth.mean()), 1.0), np.float64).ravel()


def part_with_object(rig: Rig, finder: ObjectFinder | None) -> Part:
    """Where the object is seen at rest; all of the picture where nothing else is in it. Raises RigError, BadInput."""
    if finder is None:
        return WHOLE
    frame = _at_rest(rig, _Diary(rig))
    figure = finder.figure_ground.segment(frame.image, rig.motion.read_state().position_rad, finder.track)
    box = around(figure.mask)
    if figure.problem or box is None:
        raise BadInput(f"the object cannot be found in the picture: {figure.problem}")
    grown_px = round(MARGIN * max(box.right - box.left, box.bottom - box.top))
    return box.grown(grown_px, frame.image.shape[:2]).part


def steps_of(limit: JointLimits, at_rad: float) -> FloatArray:
    """(K,) stops of a joint around where it is, with room to run up on both sides. Raises BadInput."""
    low, high = limit.lower_rad + RUN_UP_RAD, limit.upper_rad - RUN_UP_RAD
    span = min(SPAN_RAD, high - low)
    if span < 0.5 * SPAN_RAD:
        raise BadInput(
            f"joint {limit.name!r} turns by {np.degrees(limit.upper_rad - limit.lower_rad):.0f} deg only: at least "
            f"{np.degrees(0.5 * SPAN_RAD + 2.0 * RUN_UP_RAD):.0f} are needed to see latency and play"
        )
    first = float(np.clip(at_rad - 0.5 * span, low, high - span)) if np.isfinite(span + low) else at_rad - 0.5 * span
    return np.asarray(first + STOP_RAD * np.arange(int(span / STOP_RAD) + 1), np.float64)


def measure_timing(
    rig: Rig,
    joint: int,
    tick: Callable[[], None] = lambda: None,
    watch: Callable[[JointState], None] = lambda _: None,
    part: Part = WHOLE,
) -> Timing:
    """Turn one joint both ways and work out latency and play; the other joints stay, and it returns to where it was.

    Only `part` of the pictures counts: where the object is seen (`part_with_object`). `tick` hears of every stop and
    sweep (`ticks_of` says how many), `watch` of read-backs; it stops by raising. Raises RigError, Timeout, BadInput.
    """
    rest = list(rig.motion.read_state().position_rad)
    stops = steps_of(rig.motion.limits()[joint], rest[joint])
    diary, taken = _Diary(rig), _Taken(part)

    def heard(state: JointState) -> None:
        diary.keep()
        watch(state)

    def go(angle: float) -> None:
        goal = list(rest)
        goal[joint] = angle
        move_and_wait(rig.motion, rig.clock, goal, heard, ARRIVED_RAD)

    go(stops[0] - RUN_UP_RAD)
    angles, looks = [], []
    for stop in stops:
        go(stop)
        looks.append(_steady_look(rig, diary, part))
        angles.append(diary.states[-1].position_rad[joint])
        tick()
    go(stops[-1] + RUN_UP_RAD)
    for stretch, stop in enumerate(stops[::-FROM_ABOVE]):
        go(stop)
        taken.add(_at_rest(rig, diary), stretch)
        tick()
    go(stops[0] - RUN_UP_RAD)
    for sweep in range(2 * SWEEPS):
        end = stops[-1] + RUN_UP_RAD if sweep % 2 == 0 else stops[0] - RUN_UP_RAD
        goal = list(rest)
        goal[joint] = end
        _sweep(rig, goal, taken, len(stops) + sweep, heard)
        tick()
    move_and_wait(rig.motion, rig.clock, rest, heard, ARRIVED_RAD)
    encoder = ReadBacks(
        np.array([state.stamp_ns for state in diary.states]),
        np.array([state.position_rad[joint] for state in diary.states]),
    )
    frames = Frames(np.array(taken.stamp_ns), np.array(taken.feature), np.array(taken.stretch))
    return timing_of(AppearanceMap(np.array(angles), np.array(looks)), frames, encoder)


def ticks_of(limit: JointLimits, at_rad: float) -> int:
    """How often `measure_timing` ticks. Raises BadInput."""
    stops = len(steps_of(limit, at_rad))
    return stops + len(range(0, stops, FROM_ABOVE)) + 2 * SWEEPS


def _at_rest(rig: Rig, diary: _Diary) -> Frame:
    """A picture that was exposed after the joints had come to rest, however late its stamp is."""
    frame = rig.camera.read(rig.clock.now_ns() + round(LONGEST_S * 1e9), LONGEST_S + FRAME_TIMEOUT_S)
    diary.keep()
    return frame


def _steady_look(rig: Rig, diary: _Diary, part: Part) -> FloatArray:
    """The mean look of some pictures at rest: noise, and the shaking of the camera, hardly count."""
    frames = [_at_rest(rig, diary)]
    while len(frames) < STEADY:
        frames.append(rig.camera.read(frames[-1].stamp_ns + 1, FRAME_TIMEOUT_S))
    diary.keep()
    mean: FloatArray = np.mean([look_of(frame, part) for frame in frames], axis=0)
    return mean


def _sweep(rig: Rig, goal: Sequence[float], taken: _Taken, stretch: int, heard: Callable[[JointState], None]) -> None:
    """Move without a stop, and take pictures on the way."""
    rig.motion.move_to(goal)
    until_ns = rig.clock.now_ns() + round(SWEEP_TIMEOUT_S * 1e9)
    newest_ns = rig.clock.now_ns()
    while True:
        frame = rig.camera.read(newest_ns + round(FRAME_S * 1e9), FRAME_TIMEOUT_S)
        newest_ns = frame.stamp_ns
        state = rig.motion.read_state()
        heard(state)
        if fault := rig.motion.fault():
            raise RigError(fault)
        if not state.moving and np.abs(np.subtract(state.position_rad, goal)).max() < ARRIVED_RAD:
            return
        taken.add(frame, stretch)
        if rig.clock.now_ns() > until_ns:
            raise Timeout(f"a sweep did not end within {SWEEP_TIMEOUT_S:g} s")
