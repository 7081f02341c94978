"""What travels between camera, motion, engine and recorder: frozen, time-stamped, documented.

Time stamps are int nanoseconds of the session's monotonic clock (`*_ns`). Angles are radians. Arrays are never
written to after a message has been made. Messages that hold arrays compare by identity; to compare by content,
encode them (`viewsep.recordings.codec`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""Any numpy array; shapes and types stand in the docstrings."""
FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


class Phase(StrEnum):
    """Where a separation task stands (design section 1)."""

    IDLE = "idle"
    STARTING = "starting"  # driving to the start view
    EXPLORING = "exploring"  # turning until the poses converge
    APPROACHING = "approaching"  # driving to the separating view
    JUDGING = "judging"  # a separating view was reached: ratings may decide from here on
    DONE = "done"


class Outcome(StrEnum):
    """How a separation task ended."""

    IDENTIFIED = "identified"
    UNKNOWN = "unknown"  # it is none of the candidates
    INDISTINGUISHABLE = "indistinguishable"  # it is one of several that no reachable view tells apart
    UNDECIDED = "undecided"  # the budget is spent
    FAILED = "failed"


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One camera picture.

    `image` is (H, W, 3) uint8 RGB; `mask` is (H, W) bool, True on the object, or None where the camera gives none.
    `stamp_ns` is the moment of exposure, `sequence` counts exposures, so a gap in it is a dropped frame.
    """

    stamp_ns: int
    sequence: int
    image: Array
    mask: Array | None


@dataclass(frozen=True, slots=True)
class JointState:
    """What the motion backend knows at one moment: read-back and set-point, radians per joint in the rig's order.

    `fault` is empty when all is well, otherwise a sentence.
    """

    stamp_ns: int
    position_rad: tuple[float, ...]
    setpoint_rad: tuple[float, ...]
    moving: bool
    fault: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Percept:
    """What perception makes of one frame: a global, roll-invariant feature and where it was seen from.

    `feature` is (D,) float32 of the named descriptor; `view_direction` is the (3,) unit vector `c` in the control
    frame, from the joint angles interpolated at `stamp_ns`, the frame's time stamp. `notes` are
    sentences about what perception has found out of the ordinary, mostly none; `anew` says why the
    object may be another one than before, or held otherwise: what was seen of it before does not count then.
    """

    stamp_ns: int
    sequence: int
    descriptor: str
    feature: Array
    view_direction: FloatArray
    notes: tuple[str, ...] = ()
    anew: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class MoveTo:
    """The engine asks for a reachable view direction `(3,)` in the control frame. `purpose` is the phase it serves."""

    command_id: int
    view_direction: FloatArray
    purpose: Phase


@dataclass(frozen=True, slots=True)
class Stop:
    """The engine asks the motion to stop and hold."""

    command_id: int
    reason: str


Command = MoveTo | Stop


@dataclass(frozen=True, eq=False, slots=True)
class TaskStarted:
    """A separation task begins at `view_direction` (3,); `seed` is the only source of chance in the engine."""

    stamp_ns: int
    seed: int
    view_direction: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PerceptReceived:
    """Perception delivered a percept."""

    percept: Percept

    @property
    def stamp_ns(self) -> int:
        """The percept's time stamp."""
        return self.percept.stamp_ns


@dataclass(frozen=True, slots=True)
class MoveSettled:
    """The motion reports that command `command_id` has arrived and stands still."""

    stamp_ns: int
    command_id: int


@dataclass(frozen=True, slots=True)
class MoveFailed:
    """Command `command_id` could not be carried out; `reason` is a sentence."""

    stamp_ns: int
    command_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class FrameMissing:
    """No usable frame came before the deadline; `reason` is a sentence."""

    stamp_ns: int
    reason: str


@dataclass(frozen=True, slots=True)
class DeadlinePassed:
    """The task's time budget is spent."""

    stamp_ns: int


@dataclass(frozen=True, slots=True)
class CancelRequested:
    """Somebody asked to end the task."""

    stamp_ns: int
    reason: str


@dataclass(frozen=True, slots=True)
class RigFailed:
    """The rig cannot go on: it was lost, stopped or taken away; `reason` is a sentence."""

    stamp_ns: int
    reason: str


Event = (
    TaskStarted
    | PerceptReceived
    | MoveSettled
    | MoveFailed
    | FrameMissing
    | DeadlinePassed
    | CancelRequested
    | RigFailed
)


@dataclass(frozen=True, eq=False, slots=True)
class CandidateEstimate:
    """One candidate after one interpretation: its best hypothesis' rating and measures, and its pose.

    `rating` is the mean 1-based queue position (1 is best); `w0`, `w1` (radians), `w2` are that hypothesis' measures
    (section IV); `rotation` is the (3, 3) mean rotation object -> control; `variance` is the running variance of that
    mean summed over the angles (radians squared, infinite until the window is full). `probability` is None where the
    interpreter has none.
    """

    name: str
    rating: float
    w0: float
    w1: float
    w2: float
    rotation: FloatArray
    variance: float
    converged: bool
    hypotheses: int
    probability: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """What the interpreter believes after a percept. `comparisons` counts feature comparisons in this iteration.

    A task that ends between two looks tells its last estimate again, with the phase `done` and the same `iteration`.
    `target` is the (3,) view direction the planner is driving to, or None while exploring. `unknown` is the probability
    that the object is none of the candidates, None where the interpreter has no probabilities. `note` is a sentence
    about something out of the ordinary, mostly empty.
    """

    stamp_ns: int
    iteration: int
    phase: Phase
    candidates: tuple[CandidateEstimate, ...]
    comparisons: int
    travel_rad: float
    target: FloatArray | None
    unknown: float | None = None
    note: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Result:
    """How the task ended. `object` is empty unless identified; `rotation` is the named (or best) candidate's pose.

    `ratings` follow the order of the candidates. `travel_rad` is the length of the controlled path on the view sphere.
    `indistinct` names those that remain when it is indistinguishable; `telling_view` (3,) would tell them apart, but
    cannot be reached (None where there is no such view). `pose_spread_rad` is the root mean squared angle by which the
    pose may be wrong (None where it is not known).
    """

    stamp_ns: int
    outcome: Outcome
    object: str
    reason: str
    ratings: tuple[tuple[str, float], ...]
    rotation: FloatArray
    looks: int
    travel_rad: float
    comparisons: int
    indistinct: tuple[str, ...] = ()
    telling_view: FloatArray | None = None
    pose_spread_rad: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class HypothesisViews:
    """Where the interpreter's hypotheses see the object from, for people to look at; it decides nothing.

    `candidates` are the names, `owner` (P,) the index of each hypothesis' candidate, `direction` (P, 3) the view
    direction in the control frame that it believes in, `weight` (P,) its share among all of them, 0 to 1.
    """

    stamp_ns: int
    candidates: tuple[str, ...]
    owner: Array
    direction: FloatArray
    weight: FloatArray


@dataclass(frozen=True, slots=True)
class Keyframe:
    """All the engine knew after the event before, so that a replay can begin here; `state` is `Engine.save`'s."""

    stamp_ns: int
    state: bytes


Message = Frame | JointState | Event | Command | Estimate | Result | HypothesisViews | Keyframe
