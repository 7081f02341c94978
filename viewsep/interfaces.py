"""The interfaces between hardware, perception and engine. Backends and plug-ins implement these and nothing else.

Constructors are cheap and touch no device; `connect()` does. Every wait takes a deadline. Each interface has one
contract suite in `tests/contracts`, run on every implementation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from viewsep.messages import (
    Array,
    Estimate,
    FloatArray,
    Frame,
    HypothesisViews,
    JointState,
    Message,
    Outcome,
    Percept,
    Phase,
)


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of one joint in radians and radians per second; `lower_rad`, `upper_rad` infinite where it is free."""

    name: str
    lower_rad: float
    upper_rad: float
    max_speed_rad_s: float


class Clock(Protocol):
    """The only source of time."""

    def now_ns(self) -> int:
        """Monotonic nanoseconds."""
        ...

    def sleep_until(self, stamp_ns: int) -> None:
        """Return when `now_ns() >= stamp_ns`; at once if that has passed. Simulated clocks step the world instead."""
        ...


class MotionBackend(Protocol):
    """Joints that can be driven and read."""

    def connect(self) -> None:
        """Open the device and check it. Raises RigError."""
        ...

    def limits(self) -> tuple[JointLimits, ...]:
        """Limits of every joint in the rig's order; valid before `connect()`."""
        ...

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving to the set-points and return what was really commanded (after rounding to the device's steps).

        Raises MoveRefused when a set-point is outside the limits or the backend has a fault; nothing moves then.
        """
        ...

    def read_state(self) -> JointState:
        """The newest read-back, without waiting for a new one. Raises NotConnected, RigError."""
        ...

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Read-backs in order of time, from the last one at or before `since_ns` on, as far as they are remembered."""
        ...

    def stop(self) -> None:
        """Stop all joints where they are and hold. Tries every joint, then raises the first error."""
        ...

    def fault(self) -> str:
        """Empty when all is well, otherwise a sentence that says what is wrong and how to clear it."""
        ...

    def clear_fault(self) -> None:
        """Clear what can be cleared and hold. Does nothing without a fault; raises RigError with what remains."""
        ...

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The newest temperature of every joint in the rig's order, None where it is not measured."""
        ...

    def counters(self) -> Mapping[str, int]:
        """What was counted on the way to the device, by name: exchanges, retries, ...; empty where nothing is."""
        ...

    def close(self) -> None:
        """Stop and release the device. Safe to call twice; tries everything, then raises the first error."""
        ...


class CameraSource(Protocol):
    """Something that delivers time-stamped frames."""

    def connect(self) -> None:
        """Open the device and check it. Raises RigError."""
        ...

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first frame exposed after `newer_than_ns`. Raises Timeout when none comes within `timeout_s`."""
        ...

    @property
    def drops(self) -> int:
        """How many exposures never arrived since `connect()`."""
        ...

    def close(self) -> None:
        """Release the device. Safe to call twice."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Look:
    """What one look at the object gave. `percept` is None when the frame could not be used, `problem` then says why.

    `frame` is what the camera took, or None where only the percept comes over from the rig.
    """

    stamp_ns: int
    frame: Frame | None
    percept: Percept | None
    problem: str = ""


class Perception(Protocol):
    """Turns what the camera sees into percepts. It sits where the rig is: a frame is paired with read-backs there."""

    def look(self, newer_than_ns: int, timeout_s: float) -> Look:
        """The first look at what was exposed after `newer_than_ns`.

        Raises Timeout when no frame comes within `timeout_s`.
        """
        ...


@runtime_checkable
class Descriptor(Protocol):
    """A global, roll-invariant feature with a similarity (section II.2). Found by name through entry points.

    Plug-in: entry-point group `viewsep.descriptors`, value is a dataclass whose fields are its parameters.
    """

    @property
    def name(self) -> str:
        """The name it is registered under."""
        ...

    @property
    def parameters(self) -> dict[str, float | int | str]:
        """Everything that changes the features; stored in models and compared when they are used."""
        ...

    @property
    def size(self) -> int:
        """D, the number of values in a feature."""
        ...

    def describe(self, image: Array, mask: Array | None) -> Array:
        """(H, W, 3) uint8 RGB and (H, W) bool -> (D,) float32. Raises BadInput when no pixel is on the object."""
        ...

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        """(D,) against (N, D) -> (N,) float64, higher is more alike, 1 for identical (the seed's w0)."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Conclusion:
    """How a task should end, and why: `reason` is part of a sentence.

    `indistinct` are the indices of the candidates that cannot be told apart, `telling_view` (3,) as in `Result`.
    """

    outcome: Outcome
    reason: str
    indistinct: tuple[int, ...] = ()
    telling_view: FloatArray | None = None


@dataclass(frozen=True, eq=False, slots=True)
class PoseSamples:
    """What may be seen and how it may be held: `owner` (S,) candidates' indices, `rotation` (S, 3, 3), `weight` (S,).

    The weights of a candidate's samples sum to about its probability. A look tells less where it has been looked from
    before: those are the views `seen` (L, 3); `independent_rad` away from them it tells all it can.
    """

    owner: Array = field(default_factory=lambda: np.empty(0, np.int64))
    rotation: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    weight: FloatArray = field(default_factory=lambda: np.empty(0))
    seen: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    independent_rad: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Interpretation:
    """What an interpreter hands to the planner and the decision after one percept.

    `estimate` fields other than phase, travel and target are filled by the interpreter; `rotations` is (K, 3, 3),
    one pose per candidate; `converged` is True when the poses are good enough to plan with; `plausible` is (K,) bool,
    the candidates worth separating; `leader` is the index of the candidate that would be named if judged now, or -1;
    `fresh` is True while there is too little evidence since the interpreter (re)started: plans made before do not hold.
    `conclusion` is what an interpreter is sure of wherever it looked: its leader is identified, or the object is
    unknown. It is None for ratings that decide near a separating view only. `samples` stand for the posterior, empty
    where there is none. `unseen` (U, 3) are reachable views of sides of which some are to be seen before a conclusion
    is drawn; the engine fills it in.
    """

    estimate: Estimate
    rotations: FloatArray
    converged: bool
    plausible: Array
    leader: int
    fresh: bool
    conclusion: Conclusion | None = None
    samples: PoseSamples = field(default_factory=PoseSamples)
    unseen: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


class Interpreter(Protocol):
    """Turns percepts into a belief about candidates and poses. Pure: state in, state out.

    Plug-in: entry-point group `viewsep.interpreters`, value is a class with an `options_type` (a dataclass), a
    `state_type` (the dataclass that is its state, of numbers, texts, arrays and dataclasses) and a constructor
    `(models, descriptor, options)`; `gives_samples = True` where its interpretations have `samples`.
    """

    @property
    def state_type(self) -> type:
        """The dataclass of its states, so that they can be kept (`viewsep.engine.keyframe`)."""
        ...

    def start(self) -> Any:
        """The state before the first percept."""
        ...

    def update(self, state: Any, percept: Percept) -> tuple[Any, Interpretation]:
        """One iteration of the interpretation module. Does not change `state`."""
        ...

    def hypotheses(self, state: Any, stamp_ns: int) -> HypothesisViews:
        """Where the hypotheses in `state` see the object from, for people to look at."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class NextView:
    """Where a planner wants to look next.

    `view_direction` (3,) is reachable, or None to stay; `purpose` the phase the move serves; `target` (3,) the
    view it leads to, the separating one or that with the most information, or None while exploring; `arrives` is True
    when a look from the end of the move is waited for, as at the target, before going on.
    `conclusion` ends the task: no reachable view promises anything more.
    """

    view_direction: FloatArray | None
    purpose: Phase
    target: FloatArray | None = None
    arrives: bool = False
    conclusion: Conclusion | None = None


class Planner(Protocol):
    """Chooses the next view among the reachable ones. Pure: state in, state out.

    Plug-in: entry-point group `viewsep.planners`, value is a class with an `options_type` (a dataclass), a
    `state_type` (the dataclass that is its state) and a constructor `(models, reachable, options)`; `needs_samples =
    True` where it can plan with nothing else.
    """

    @property
    def state_type(self) -> type:
        """The dataclass of its states, so that they can be kept (`viewsep.engine.keyframe`)."""
        ...

    def start(self, seed: int, view_direction: FloatArray) -> tuple[Any, NextView]:
        """The state at the start of a task and the start view (None to start where the rig is)."""
        ...

    def next_view(self, state: Any, view_direction: FloatArray, belief: Interpretation | None) -> tuple[Any, NextView]:
        """The next reachable view direction from `view_direction` (3,), given the newest belief (None before any)."""
        ...


class Listener(Protocol):
    """Hears everything that crosses an arrow of the loop: the recorder, the live table, the service."""

    def hear(self, stamp_ns: int, message: Message) -> None:
        """`message` was read, issued or concluded at `stamp_ns`. An event is heard just before the engine takes it."""
        ...
