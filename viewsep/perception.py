"""From a frame to a percept: feature and view direction at the frame's moment (section III.B)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.errors import Timeout
from viewsep.interfaces import Descriptor
from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray, Frame, JointState, Percept


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


def position_at(stamp_ns: int, history: Sequence[JointState]) -> FloatArray:
    """Joint angles (n,) at a moment, interpolated between the two read-backs around it. Raises Timeout."""
    if not history or not history[0].stamp_ns <= stamp_ns <= history[-1].stamp_ns:
        raise Timeout("no joint read-backs around the frame's time stamp: is the motion backend still answering?")
    # relative times: int nanoseconds since boot do not fit a float exactly
    times = np.array([state.stamp_ns - stamp_ns for state in history], float)
    positions = np.array([state.position_rad for state in history])
    return np.array([np.interp(0.0, times, joint) for joint in positions.T])
