"""From a frame to a percept: feature and view direction at the frame's moment (section III.B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from viewsep.errors import BadInput, Timeout
from viewsep.interfaces import Descriptor, Look
from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray, Frame, JointState, Percept
from viewsep.perception.exposure import clipped
from viewsep.perception.finder import ObjectFinder
from viewsep.session import Rig

POLL_NS = 5_000_000


class RigPerception:
    """`Perception` beside the rig: camera, read-backs and descriptor in one process.

    Frames without a mask go through the `finder`, if there is one; a look's frame is then what it cut out, so that the
    percept can be made again from it, or the whole picture where no good mask was found.
    """

    def __init__(self, rig: Rig, descriptor: Descriptor, finder: ObjectFinder | None = None) -> None:
        self._rig = rig
        self._descriptor = descriptor
        self._finder = finder

    def look(self, newer_than_ns: int, timeout_s: float) -> Look:
        """Read a frame and pair it with the joint angles at its moment. Raises Timeout when none comes."""
        frame = self._rig.camera.read(newer_than_ns, timeout_s)
        try:
            history = self._history_around(frame.stamp_ns, timeout_s)
            notes: tuple[str, ...] = ()
            anew = ""
            if frame.mask is None and self._finder is not None:
                frame = self._finder.find(frame, position_at(frame.stamp_ns, history).tolist())
                notes, anew = self._finder.notes, self._finder.anew
            percept = perceive(frame, history, self._rig.geometry, self._descriptor)
            return Look(frame.stamp_ns, frame, replace(percept, notes=(*notes, *_exposure(frame)), anew=anew))
        except (Timeout, BadInput) as error:
            return Look(frame.stamp_ns, frame, None, str(error))

    def _history_around(self, stamp_ns: int, timeout_s: float) -> tuple[JointState, ...]:
        """Read-backs around a moment; waits for the one after it."""
        deadline_ns = self._rig.clock.now_ns() + round(timeout_s * 1e9)
        history = self._rig.motion.history(stamp_ns)
        while (not history or history[-1].stamp_ns < stamp_ns) and self._rig.clock.now_ns() < deadline_ns:
            self._rig.clock.sleep_until(self._rig.clock.now_ns() + POLL_NS)
            history = self._rig.motion.history(stamp_ns)
        return history


def perceive(frame: Frame, history: Sequence[JointState], geometry: RigGeometry, descriptor: Descriptor) -> Percept:
    """The percept of a frame. Raises Timeout when no read-backs lie around it, BadInput when it shows no object."""
    position = position_at(frame.stamp_ns, history)
    return Percept(
        stamp_ns=frame.stamp_ns,
        sequence=frame.sequence,
        descriptor=descriptor.name,
        feature=descriptor.describe(frame.image, frame.mask),
        view_direction=geometry.view_direction(position.tolist()),
    )


def _exposure(frame: Frame) -> tuple[str, ...]:
    """What is wrong with the exposure of a frame's object, if anything."""
    note = "" if frame.mask is None else clipped(frame.image[frame.mask]).note
    return (note,) if note else ()


def position_at(stamp_ns: int, history: Sequence[JointState]) -> FloatArray:
    """Joint angles (n,) at a moment, interpolated between the two read-backs around it. Raises Timeout."""
    if not history or not history[0].stamp_ns <= stamp_ns <= history[-1].stamp_ns:
        raise Timeout("no joint read-backs around the frame's time stamp: is the motion backend still answering?")
    # relative times: int nanoseconds since boot do not fit a float exactly
    times = np.array([state.stamp_ns - stamp_ns for state in history], float)
    positions = np.array([state.position_rad for state in history])
    return np.array([np.interp(0.0, times, joint) for joint in positions.T])
