"""What goes beside the recorded messages so that Foxglove, Lichtblick and Rerun show a task without a plug-in.

Everything here follows from the messages, the configuration and the models; nothing of it is read back or replayed.
The scene's unit of length is the radius of the view sphere, since no distance of a rig is known.

Frames: `base` is fixed, as `camera` in it is; each `joint/NAME` turns in the one before, and the last one carries
`control`, the frame that holds the object. `object/NAME` is the pose of a candidate in `control`.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message as Protobuf

from viewsep.account import Account
from viewsep.config import Config, geometry_of
from viewsep.geometry import angle_between, azimuth_elevation, rotation_angle
from viewsep.kinematics import RigGeometry
from viewsep.messages import (
    Array,
    CancelRequested,
    CandidateEstimate,
    DeadlinePassed,
    Estimate,
    FloatArray,
    FrameMissing,
    HypothesisViews,
    JointState,
    Message,
    MoveFailed,
    Outcome,
    PerceptReceived,
    Phase,
    Result,
    RigFailed,
    TaskStarted,
)
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.codec import CAMERA_FRAME
from viewsep.recordings.drawing import log, points, pose, transform, turned, turned_about

CHANNELS: Mapping[str, type[Protobuf]] = {
    "tf": FrameTransform,
    "pose": PoseInFrame,
    "sphere/views": PointCloud,
    "sphere/path": PointCloud,
    "sphere/hypotheses": PointCloud,
    "log": Log,
}
"""Every topic of the scene and the protobuf message on it."""

BASE, CONTROL = "base", "control"
RERUN_ROOT = "tf#/"  # Rerun's name for the frame of its 3D view, which shows only what hangs together with it
CAMERA_AT = 2.0  # radii of the view sphere from its centre
LONGEST_PATH = 500
FIXED_EVERY_NS = 1_000_000_000  # what never moves is told again, for whoever starts in the middle
MOVED_RAD = np.radians(0.1)

# Okabe and Ito's colours, for any kind of sight; the path's is none of the candidates'
_CANDIDATES = np.array([[0, 114, 178], [0, 158, 115], [204, 121, 167], [86, 180, 233], [230, 159, 0], [240, 228, 66]])
_PATH = np.array([213, 94, 0])

Shown = Iterator[tuple[str, Protobuf]]

_PHASES = {
    Phase.STARTING: "Driving to the start view.",
    Phase.EXPLORING: "Exploring: turning until the poses have converged.",
    Phase.APPROACHING: "Driving to the separating view",
    Phase.JUDGING: "Judging: the separating view was reached, from here on the ratings may decide.",
}
_LEVELS = {
    Outcome.IDENTIFIED: Log.INFO,
    Outcome.UNKNOWN: Log.WARNING,
    Outcome.INDISTINGUISHABLE: Log.WARNING,
    Outcome.UNDECIDED: Log.WARNING,
    Outcome.FAILED: Log.ERROR,
}


class Scene:
    """Turns the messages of a session into standard ones. It remembers the path so far; a new task starts it anew.

    `config` is the one the session runs with, `models` are its candidates. The same messages make the same scene.
    """

    def __init__(self, config: Config, models: Sequence[AspectGraph]) -> None:
        geometry = geometry_of(config.rig)
        camera = geometry.camera_direction
        self._joints = _joint_frames(geometry)
        self._axes: list[list[float]] = geometry.axes.tolist()
        self._camera = turned(_facing(camera)), tuple(float(x) for x in CAMERA_AT * camera)
        self._views = {model.name: model.directions for model in models}
        self._fixed_ns: int | None = None
        self._fault = ""
        self._start()

    def show(self, stamp_ns: int, message: Message) -> list[tuple[str, Protobuf]]:
        """The standard messages that go beside `message`, which was heard at `stamp_ns`, each with its topic."""
        return [*self._draw(stamp_ns, message), *(("log", log(stamp_ns, *line)) for line in self._say(message))]

    def _start(self) -> None:
        self._path: deque[tuple[int, FloatArray]] = deque(maxlen=LONGEST_PATH)
        self._looks = 0
        self._phase = Phase.STARTING
        self._best: tuple[str, FloatArray] | None = None

    def _draw(self, stamp_ns: int, message: Message) -> Shown:
        match message:
            case JointState():
                yield from self._rig(stamp_ns, message.position_rad)
            case TaskStarted():
                self._start()
                yield from self._seen_from(stamp_ns, message.view_direction)
            case PerceptReceived():
                self._looks += 1
                yield from self._seen_from(stamp_ns, message.percept.view_direction)
            case Estimate():
                yield from self._poses(stamp_ns, message.candidates)
            case HypothesisViews():
                yield "sphere/hypotheses", _hypotheses(stamp_ns, message)
            case _:
                return

    def _rig(self, stamp_ns: int, position_rad: Sequence[float]) -> Shown:
        """The joints where they were read back. Those of another rig, or without a position, cannot be drawn."""
        if len(position_rad) != len(self._joints) or not all(map(math.isfinite, position_rad)):
            return
        if self._fixed_ns is None or abs(stamp_ns - self._fixed_ns) >= FIXED_EVERY_NS:
            self._fixed_ns = stamp_ns
            yield "tf", transform(stamp_ns, RERUN_ROOT, BASE)
            yield "tf", transform(stamp_ns, BASE, CAMERA_FRAME, *self._camera)
            yield "tf", transform(stamp_ns, self._joints[-1], CONTROL)
        parents = (BASE, *self._joints)
        for parent, frame, axis, angle in zip(parents, self._joints, self._axes, position_rad, strict=False):
            yield "tf", transform(stamp_ns, parent, frame, turned_about(axis, angle))

    def _seen_from(self, stamp_ns: int, view: FloatArray) -> Shown:
        """The path with one more view, if it is another one than the last."""
        if self._path and angle_between(self._path[-1][1], view) < MOVED_RAD:
            return
        self._path.append((self._looks, view))
        looks, views = zip(*self._path, strict=True)
        # the older a view, the darker: the newest one is where the camera is
        light = np.linspace(0.3, 1.0, len(views) + 1)[1:, None]
        colour = np.hstack([light * _PATH, np.full((len(views), 1), 255)]).round()
        yield "sphere/path", points(stamp_ns, CONTROL, np.array(views), colour, [("look", "<u4", np.array(looks))])

    def _poses(self, stamp_ns: int, candidates: Sequence[CandidateEstimate]) -> Shown:
        """Where each candidate would be, and the views of the best rated one where they would be seen."""
        drawable = [index for index, candidate in enumerate(candidates) if _is_rotation(candidate.rotation)]
        for candidate in (candidates[index] for index in drawable):
            yield "tf", transform(stamp_ns, CONTROL, f"object/{candidate.name}", turned(candidate.rotation))
        if not drawable:
            return
        index = min(drawable, key=lambda k: candidates[k].rating)
        best = candidates[index]
        yield "pose", pose(stamp_ns, CONTROL, turned(best.rotation))
        if best.name in self._views and self._moved(best):
            self._best = best.name, best.rotation
            views = self._views[best.name] @ best.rotation.T
            node = ("node", "<u4", np.arange(len(views)))
            yield "sphere/views", points(stamp_ns, CONTROL, views, _colours(np.full(len(views), index)), [node])

    def _moved(self, best: CandidateEstimate) -> bool:
        if self._best is None or self._best[0] != best.name:
            return True
        return bool(rotation_angle(self._best[1], best.rotation) >= MOVED_RAD)

    def _say(self, message: Message) -> Iterator[tuple[Log.Level.ValueType, str]]:
        """What there is to say about a message, with its level."""
        match message:
            case TaskStarted(seed=seed):
                yield Log.INFO, f"Task started with seed {seed}; candidates: {', '.join(self._views)}."
            case MoveFailed(command_id=command_id, reason=reason):
                yield Log.WARNING, f"Move {command_id} failed: {reason}"
            case FrameMissing(reason=reason):
                yield Log.WARNING, f"No frame: {reason}"
            case DeadlinePassed():
                yield Log.WARNING, "The time for this task is up."
            case CancelRequested(reason=reason):
                yield Log.WARNING, f"Cancelled: {reason}"
            case RigFailed(reason=reason):
                yield Log.ERROR, f"The rig failed: {reason}"
            case Result(outcome=outcome):
                account = Account.of(message)
                yield _LEVELS[outcome], f"{account.ending[:1].upper()}{account.ending[1:]}: {account.grounds}"
            case Estimate(phase=phase) if phase != self._phase:
                self._phase = phase
                if phase in _PHASES:
                    yield Log.INFO, _PHASES[phase] + _where(message)
            case JointState(fault=fault) if fault != self._fault:
                self._fault = fault
                yield (Log.ERROR, f"Fault: {fault}") if fault else (Log.INFO, "The fault is cleared.")
            case _:
                return


def _where(estimate: Estimate) -> str:
    """The end of the sentence about driving to a view."""
    if estimate.phase is not Phase.APPROACHING:
        return ""
    if estimate.target is None:
        return "."
    azimuth, elevation = np.degrees(azimuth_elevation(estimate.target))
    return f" at azimuth {azimuth:.1f} deg, elevation {elevation:.1f} deg."


def _joint_frames(geometry: RigGeometry) -> tuple[str, ...]:
    """A frame's name for each joint; joints that share a name are told apart by their place."""
    names = [limit.name for limit in geometry.limits]
    often = Counter(names)
    return tuple(
        f"joint/{name}" if often[name] == 1 else f"joint/{name}/{place}" for place, name in enumerate(names, 1)
    )


def _facing(camera_direction: FloatArray) -> FloatArray:
    """(3, 3) axes of a camera in (3,) `camera_direction` that looks at the origin: x right, y down, z forward.

    Rigs have the camera at azimuth 0, so that its right is y of the base, however high it stands.
    """
    forward, right = -camera_direction, np.array([0.0, 1.0, 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def _is_rotation(matrix: FloatArray) -> bool:
    return bool(np.isfinite(matrix).all() and np.linalg.det(matrix) > 0)


def _hypotheses(stamp_ns: int, seen: HypothesisViews) -> PointCloud:
    """Every hypothesis where it believes the camera to be; the less it weighs, the more transparent."""
    colour = _colours(seen.owner)
    if len(seen.weight):
        colour[:, 3] = np.round(255 * (0.2 + 0.8 * seen.weight / (seen.weight.max() or 1.0)))
    fields = [("weight", "<f4", seen.weight), ("candidate", "<u4", seen.owner)]
    return points(stamp_ns, CONTROL, seen.direction, colour, fields)


def _colours(candidate: Array) -> Array:
    """(N, 4) uint8 for candidates (N,) by their index."""
    colour = np.full((len(candidate), 4), 255, np.uint8)
    colour[:, :3] = _CANDIDATES[candidate % len(_CANDIDATES)]
    return colour
