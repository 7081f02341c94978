"""Where the camera was, seen from the object, at every recorded picture.

The camera is fixed and the object turns: with the joint angles q at a picture's time stamp, interpolated as perception
does it, the holder's rotation is H(q) (`RigGeometry.holder_rotation`), and the candidate's pose R turns object into
control frame. A point x of the object is at W H(q) R x + (0, 0, distance) in the camera's frame, where W turns the
world into the camera's axes. That W knows which way is up makes the roll about the line of sight come out right.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.errors import BadInput, Timeout
from viewsep.geometry import perpendicular, unit
from viewsep.kinematics import RigGeometry
from viewsep.messages import CandidateEstimate, Estimate, FloatArray, JointState, Percept, PerceptReceived, Result
from viewsep.perception import position_at
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.jpeg import jpeg_size
from viewsep.recordings.reader import Recording

STRAIGHT_DOWN = 0.99  # of a camera direction's z: nearer to the poles than that, z cannot say where up is


@dataclass(frozen=True, slots=True)
class Optics:
    """A pinhole camera with square pixels that looks at the object's centre from `distance`, in the given `unit`.

    `fov_rad` is the angle that the picture's width covers.
    """

    fov_rad: float
    distance: float
    unit: str

    def focal_px(self, width_px: int) -> float:
        """The focal length for pictures of this width."""
        return float(width_px / 2.0 / np.tan(self.fov_rad / 2.0))


@dataclass(frozen=True, eq=False, slots=True)
class ObjectPose:
    """How a candidate stands in the holder: (3, 3) rotation object -> control, `number` its place from 1 on."""

    name: str
    number: int
    rotation: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PosedPicture:
    """A picture with its size (width, height) and the (3, 3) `rotation` object -> camera.

    The camera's axes are OpenCV's: x to the right, y down, z along the line of sight. The object's centre is at
    (0, 0, distance).
    """

    frame: RecordedFrame
    size_px: tuple[int, int]
    rotation: FloatArray

    @property
    def view_direction(self) -> FloatArray:
        """(3,) unit vector from the object to the camera, in the object frame."""
        direction: FloatArray = -self.rotation[2]
        return direction


def object_pose(recording: Recording, candidates: Sequence[str], name: str | None) -> ObjectPose:
    """The pose at the end of the task of candidate `name`, or of the named or best one. Raises BadInput."""
    last: Estimate | None = None
    result: Result | None = None
    for recorded in recording.messages:
        if isinstance(recorded.message, Estimate):
            last = recorded.message
        elif isinstance(recorded.message, Result):
            result = recorded.message
    if last is None or not last.candidates:
        raise BadInput("the recording holds no estimate, so no pose of the object is known; choose another recording")
    chosen = name or (result.object if result else "") or min(last.candidates, key=_rating).name
    for candidate in last.candidates:
        if candidate.name == chosen and chosen in candidates:
            return ObjectPose(chosen, list(candidates).index(chosen) + 1, candidate.rotation)
    raise BadInput(f"{chosen!r} is no candidate of the recording: choose one of {', '.join(candidates)}")


def _rating(candidate: CandidateEstimate) -> float:
    return candidate.rating


def used_percepts(recording: Recording) -> list[tuple[Percept, Estimate]]:
    """The percepts that the interpreter used, each with the estimate that came of it."""
    used = []
    before: PerceptReceived | None = None
    for recorded in recording.messages:
        message = recorded.message
        if isinstance(message, PerceptReceived):
            before = message
        elif isinstance(message, Estimate) and before is not None:
            used.append((before.percept, message))
            before = None
        elif recorded.topic == "event":
            before = None
    return used


def posed_pictures(recording: Recording, geometry: RigGeometry, rotation: FloatArray) -> list[PosedPicture]:
    """All pictures with joint angles around them, in order, for an object that stands at `rotation` in the holder."""
    history = [recorded.message for recorded in recording.messages if isinstance(recorded.message, JointState)]
    history.sort(key=lambda state: state.stamp_ns)
    camera = camera_axes(geometry.camera_direction)
    posed = []
    for frame in recording.frames:
        after = bisect_left(history, frame.stamp_ns, key=lambda state: state.stamp_ns)
        try:
            position = position_at(frame.stamp_ns, history[max(after - 1, 0) : after + 1])
        except Timeout:
            continue
        holder = geometry.holder_rotation(position.tolist())
        posed.append(PosedPicture(frame, jpeg_size(frame.jpeg), camera @ holder @ rotation))
    return posed


def camera_axes(camera_direction: FloatArray) -> FloatArray:
    """(3, 3) rotation world -> camera of a camera in that direction, upright: the world's z points up in the picture.

    Of a camera above or below the object, `perpendicular` says where up is.
    """
    up = np.array([0.0, 0.0, 1.0])
    if abs(camera_direction[2]) > STRAIGHT_DOWN:
        up = perpendicular(camera_direction)
    right = unit(np.cross(up, camera_direction))
    axes: FloatArray = np.stack([right, np.cross(right, camera_direction), -camera_direction])
    return axes
