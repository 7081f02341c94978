"""A recording's percepts through another method than the one that was recorded: what would it have made of them?

A shadow engine is told what came from outside: that the task began, every percept, missing frames, the deadline, a
cancellation, the loss of the rig. It steers nothing, the recorded path is all it is shown. So its moves arrive when
these rules say so, the first that fits, and at most one after each percept, at the percept's time stamp:

1. Where the recorded engine was driving to the very same view just then, the move arrives, or fails, when the recorded
   one did. With the recorded method that holds for every move, so the shadow takes the recorded course look by look.
2. A separating view is reached once the path comes within `judge_within_rad` of it: so near the rating decides anyway.
   If it never does, the shadow waits to the end, unless its hypotheses begin anew: that makes the plan void.
3. Every other view (a start view, one of an exploration, one on the way to a separating view) only leads somewhere,
   and counts as reached with the next percept: the recorded path leads elsewhere, and stands for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.errors import BadInput, BadRecording
from viewsep.geometry import angle_between
from viewsep.interfaces import Descriptor
from viewsep.kinematics import VIEW_TOLERANCE_RAD
from viewsep.messages import (
    Estimate,
    Event,
    FrameMissing,
    MoveFailed,
    MoveSettled,
    MoveTo,
    Percept,
    PerceptReceived,
    Result,
    Stop,
    TaskStarted,
)
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.codec import Recordable
from viewsep.recordings.reader import Recording


class Ending(StrEnum):
    """How a method's course through a recording ended."""

    IDENTIFIED = "identified"
    UNKNOWN = "unknown"
    INDISTINGUISHABLE = "indistinguishable"
    UNDECIDED = "undecided"
    FAILED = "failed"
    RECORDING_ENDS = "recording ends"  # before the method decided or gave up


@dataclass(frozen=True, slots=True)
class Course:
    """What a method made of a recording's percepts. `object` is empty unless identified, `travel_rad` as in `Result`.

    `indistinct` names the candidates, in alphabetical order, that remain when they are indistinguishable.
    `leading` is who was rated best at the last look, empty where nobody was alone in that, and `leads_since` the look
    (from 1) from which on that stayed so; 0 where there was none.
    """

    ending: Ending
    object: str
    reason: str
    looks: int
    travel_rad: float
    comparisons: int
    leading: str
    leads_since: int
    indistinct: tuple[str, ...] = ()

    def agrees(self, other: Course) -> bool | None:
        """Whether both decided the same; None where the recording ended before one of them did."""
        if Ending.RECORDING_ENDS in (self.ending, other.ending):
            return None
        return (self.ending, self.object, self.indistinct) == (other.ending, other.object, other.indistinct)


def recorded_course(recording: Recording) -> Course:
    """The course of the method that was recorded."""
    messages = [row.message for row in recording.messages]
    results = [message for message in messages if isinstance(message, Result)]
    return _course(results[-1] if results else None, [message for message in messages if isinstance(message, Estimate)])


def what_if(
    recording: Recording, config: Config, models: Sequence[AspectGraph], descriptor: Descriptor | None = None
) -> Course:
    """The course of the method that `config` and `models` make; with a `descriptor` it sees the pictures anew.

    Raises BadRecording where the recording does not hold the beginning of its task or the pictures, and what
    `make_engine` raises.
    """
    if not any(isinstance(row.message, TaskStarted) for row in recording.messages):
        raise BadRecording("the beginning of the task is not in the recording: give its first file as well")
    shadow = Shadow(make_engine(config, models))
    perceived = _as_recorded if descriptor is None else _seen_anew(recording, descriptor)
    estimates: list[Estimate] = []
    for place, row in enumerate(recording.messages):
        if place in recording.gaps:
            shadow.lose()
        estimates += shadow.hear(perceived(row.message) if isinstance(row.message, PerceptReceived) else row.message)
        if shadow.state.result is not None:
            break
    return _course(shadow.state.result, estimates)


class Shadow:
    """An engine that is shown the recording of another one's task; the module says when its moves arrive."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.state: EngineState = engine.start()
        self._recorded: MoveTo | None = None
        self._seen: Percept | None = None  # it waits, as what the recorded engine did then stands behind it

    def hear(self, message: Recordable) -> list[Estimate]:
        """Take the next recorded message; the estimates that came of it."""
        if isinstance(message, MoveTo | Stop):
            self._recorded = message if isinstance(message, MoveTo) else None
        if not isinstance(message, Event):
            return []
        self._arrive()
        if isinstance(message, MoveSettled | MoveFailed):
            return self._share(message)
        if isinstance(message, PerceptReceived):
            self._seen = message.percept
        return self._feed(message)

    def lose(self) -> None:
        """Messages are missing here, so what the recorded engine is driving to is not known."""
        self._recorded = None

    def _share(self, event: MoveSettled | MoveFailed) -> list[Estimate]:
        """The recorded move has ended: so has the shadow's where it was the same."""
        if self._recorded is None or event.command_id != self._recorded.command_id:
            return []
        move = self.state.move
        same = move is not None and self._is_recorded(move)
        self._recorded = None
        return self._feed(replace(event, command_id=move.command_id)) if move is not None and same else []

    def _arrive(self) -> None:
        """Feed the arrival that the newest percept stands for, where it does."""
        percept, self._seen = self._seen, None
        move, plan = self.state.move, self.state.move_plan
        if percept is None or move is None or plan is None or self._is_recorded(move):
            return
        if not plan.arrives or self._is_void() or self._reaches(move, percept):
            self._feed(MoveSettled(percept.stamp_ns, move.command_id))

    def _is_recorded(self, move: MoveTo) -> bool:
        """Whether the recorded engine is driving to the view of `move`."""
        if self._recorded is None:
            return False
        return bool(angle_between(move.view_direction, self._recorded.view_direction) < VIEW_TOLERANCE_RAD)

    def _is_void(self) -> bool:
        """Whether the hypotheses that the plan was made with are gone."""
        return self.state.belief is not None and self.state.belief.fresh

    def _reaches(self, move: MoveTo, percept: Percept) -> bool:
        away = angle_between(move.view_direction, percept.view_direction)
        return bool(away <= self.engine.limits.judge_within_rad)

    def _feed(self, event: Event) -> list[Estimate]:
        before = self.state.estimate
        self.state, _ = self.engine.step(self.state, event)
        after = self.state.estimate
        return [after] if after is not None and after is not before else []


def _as_recorded(event: PerceptReceived) -> Event:
    return event


def _seen_anew(recording: Recording, descriptor: Descriptor) -> Callable[[PerceptReceived], Event]:
    """What perception with `descriptor` makes of the picture of a recorded percept. Raises BadRecording."""
    if not recording.frames:
        raise BadRecording("the recording holds no pictures, and another descriptor can be tried on pictures only")
    frames = {frame.stamp_ns: frame for frame in recording.frames}

    def see(event: PerceptReceived) -> Event:
        percept = event.percept
        if percept.stamp_ns not in frames:
            raise BadRecording(f"the picture of the percept at {percept.stamp_ns} ns is not in the recording")
        frame = frames[percept.stamp_ns].decode()
        try:
            feature = descriptor.describe(frame.image, frame.mask)
        except BadInput as error:
            return FrameMissing(percept.stamp_ns, str(error))
        return PerceptReceived(replace(percept, descriptor=descriptor.name, feature=feature))

    return see


def _course(result: Result | None, estimates: Sequence[Estimate]) -> Course:
    leading, since = _lead(estimates)
    if result is not None:
        return Course(
            ending=Ending(result.outcome.value),
            object=result.object,
            reason=result.reason,
            looks=result.looks,
            travel_rad=result.travel_rad,
            comparisons=result.comparisons,
            leading=leading,
            leads_since=since,
            indistinct=tuple(sorted(result.indistinct)),
        )
    made = {estimate.iteration: estimate.comparisons for estimate in estimates}
    return Course(
        ending=Ending.RECORDING_ENDS,
        object="",
        reason="the recording ends before there is a decision",
        looks=estimates[-1].iteration if estimates else 0,
        travel_rad=estimates[-1].travel_rad if estimates else 0.0,
        comparisons=sum(made.values()),
        leading=leading,
        leads_since=since,
    )


def _lead(estimates: Iterable[Estimate]) -> tuple[str, int]:
    """Who was rated best at the last look, and since which look."""
    leading, since = "", 0
    for estimate in estimates:
        best = min(candidate.rating for candidate in estimate.candidates)
        names = [candidate.name for candidate in estimate.candidates if candidate.rating == best]
        now = names[0] if len(names) == 1 else ""
        if now != leading:
            leading, since = now, estimate.iteration
    return (leading, since) if leading else ("", 0)
