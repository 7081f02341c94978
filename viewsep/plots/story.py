"""A recorded task told again: what was seen, believed, planned and concluded, look by look."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between
from viewsep.interfaces import Interpretation, Interpreter
from viewsep.interpretation.interpreter import PathInterpreter, PathState
from viewsep.messages import Array, FloatArray, Outcome, Percept, PerceptReceived, Phase, Result, TaskStarted
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.reader import Recorded, Recording
from viewsep.recordings.replay import replay, restore


@dataclass(frozen=True, eq=False, slots=True)
class Look:
    """One iteration of the interpretation; `phase` is the one the view was seen in.

    `plan` is the belief that chose the separating view that was driven to or stood at, None while exploring. `leads`
    says who led (its index, or -1) and at how many judged looks in a row; `travel_rad` is the way up to this look.
    """

    percept: Percept
    phase: Phase
    belief: Interpretation
    plan: Interpretation | None
    leads: tuple[int, int]
    travel_rad: float


@dataclass(frozen=True, eq=False, slots=True)
class Target:
    """A separating view `direction` (3,), chosen at `stamp_ns` by what was believed then."""

    direction: FloatArray
    stamp_ns: int
    belief: Interpretation


@dataclass(frozen=True, eq=False)
class Story:
    """A replayed recording; `course` holds the phases and when each began, `frames` are in order of time.

    `end` is the engine's state after the last event, `recorded` the result that the recording holds; None without.
    """

    recording: Recording
    config: Config
    models: list[AspectGraph]
    interpreter: Interpreter
    task: dict[str, str]
    looks: list[Look]
    targets: list[Target]
    course: list[tuple[int, Phase]]
    end: EngineState | None
    recorded: Result | None
    frames: list[RecordedFrame]

    @cached_property
    def messages(self) -> tuple[Recorded, ...]:
        """What was heard from the beginning of the task on."""
        heard = self.recording.messages
        begins = [i for i, recorded in enumerate(heard) if isinstance(recorded.message, TaskStarted)]
        return heard[begins[-1] if begins else 0 :]

    @property
    def result(self) -> Result | None:
        """What the engine concluded when it was given the recorded events again."""
        return self.end.result if self.end else None

    @property
    def differs(self) -> bool:
        """Whether the replay ended otherwise than what is recorded."""
        return _decision(self.recorded) != _decision(self.result)

    @property
    def by_information(self) -> bool:
        """Whether the planner drives to what promises information and waits for looks on the way, too."""
        return self.config.planner.name == "information"

    @property
    def goal(self) -> str:
        """What the views are called that the planner drives to."""
        return "telling view" if self.by_information else "separating view"

    @property
    def truth(self) -> str:
        """What the rig held, empty where that was not recorded."""
        return self.task.get("truth", "")

    @property
    def correct(self) -> bool | None:
        """Whether what was said is so; None where nothing was, or the truth was not recorded."""
        if self.result is None or not self.truth:
            return None
        match self.result.outcome:
            case Outcome.IDENTIFIED:
                return self.result.object == self.truth
            case Outcome.UNKNOWN:
                return self.truth not in [model.name for model in self.models]
            case Outcome.INDISTINGUISHABLE:
                return self.truth in self.result.indistinct
        return None

    @cached_property
    def has_probabilities(self) -> bool:
        """Whether the interpreter said how probable the candidates are."""
        return any(c.probability is not None for look in self.looks for c in look.belief.estimate.candidates)

    @cached_property
    def unknown(self) -> FloatArray:
        """(H,) the probability that it is none of the candidates, nan where there is none; empty without any."""
        said = [look.belief.estimate.unknown for look in self.looks]
        if not self.has_probabilities or all(probability is None for probability in said):
            return np.empty(0)
        return np.array(said, np.float64)

    @cached_property
    def controlled(self) -> FloatArray:
        """(H, 3) the controlled path."""
        return np.array([look.percept.view_direction for look in self.looks]).reshape(-1, 3)

    @cached_property
    def separating_views(self) -> FloatArray:
        """(T, 3) where the targets lie."""
        return np.array([target.direction for target in self.targets]).reshape(-1, 3)

    @cached_property
    def judged(self) -> list[Look]:
        """The looks that were near enough to a separating view to decide."""
        before = [(-1, 0), *(look.leads for look in self.looks)]
        return [look for look, leads in zip(self.looks, before, strict=False) if look.leads != leads]

    @cached_property
    def ranking(self) -> list[int]:
        """Candidates in the order of their last rating, best first."""
        if not self.looks:
            return list(range(len(self.models)))
        return [int(k) for k in np.argsort(self.series("rating")[-1], kind="stable")]

    @property
    def iterations(self) -> Array:
        """(H,) the looks' numbers, from 1."""
        return np.arange(1, len(self.looks) + 1)

    @property
    def brute_force(self) -> int:
        """Comparisons per look if every node of every candidate were compared."""
        return sum(len(model.directions) for model in self.models)

    def series(self, measure: str) -> FloatArray:
        """(H, K) a measure of the candidates' estimates over the iterations, nan where there is none."""
        rows = [[getattr(c, measure) for c in look.belief.estimate.candidates] for look in self.looks]
        return np.array(rows, np.float64).reshape(len(rows), len(self.models))

    def frame_at(self, look: Look) -> RecordedFrame:
        """The recorded frame nearest in time. Only where there are frames."""
        stamp_ns = look.percept.stamp_ns
        after = bisect_left(self.frames, stamp_ns, key=lambda frame: frame.stamp_ns)
        near = self.frames[max(0, after - 1) : after + 1]
        return min(near, key=lambda frame: abs(frame.stamp_ns - stamp_ns))

    def expected_node(self, k: int, belief: Interpretation, direction: FloatArray) -> int:
        """The node of candidate `k` that should be seen from `direction` (3,) if the belief about its pose is right."""
        expected = belief.rotations[k].T @ direction
        return int(np.argmin(angle_between(self.models[k].directions, expected)))

    def hypotheses(self, k: int) -> tuple[list[FloatArray], FloatArray]:
        """A candidate's paths (H, 3) at the end in the control frame, best first, and the best one's rotation (3, 3).

        No paths and the estimated rotation for an interpreter without path hypotheses.
        """
        state = self.end.interpretation if self.end else None
        if (
            not isinstance(state, PathState)
            or not isinstance(self.interpreter, PathInterpreter)
            or not state.hypotheses
        ):
            return [], self.looks[-1].belief.rotations[k]
        mine = state.hypotheses.take(np.flatnonzero(self.interpreter.owner(state.hypotheses) == k))
        mine = mine.take(np.lexsort((mine.w1, mine.rating)))
        directions = self.interpreter.candidates.directions
        paths = [directions[hits] @ rotation.T for hits, rotation in zip(mine.hits, mine.rotation, strict=True)]
        return paths, mine.rotation[0]


def retell(recording: Recording) -> Story:
    """Replay the recording and keep what people want to see. Raises BadRecording when it cannot be replayed."""
    config, models = restore(recording)
    looks: list[Look] = []
    targets: list[Target] = []
    course: list[tuple[int, Phase]] = []
    end: EngineState | None = None
    for step in replay(recording):
        before, end = end or EngineState(), step.state
        if isinstance(step.event, TaskStarted):
            looks, targets, course = [], [], []
        if isinstance(step.event, PerceptReceived) and end.belief is not None and end.belief is not before.belief:
            plan = targets[-1].belief if targets and before.phase in (Phase.APPROACHING, Phase.JUDGING) else None
            looks.append(Look(step.event.percept, before.phase, end.belief, plan, end.leads, end.travel_rad))
        target = end.move_plan.target if end.move_plan else None
        known = before.move_plan.target if before.move_plan else None
        if target is not None and end.belief and (known is None or not np.array_equal(target, known)):
            targets.append(Target(target, step.event.stamp_ns, end.belief))
        if not course or course[-1][1] is not end.phase:
            course.append((step.event.stamp_ns, end.phase))
    return Story(
        recording=recording,
        config=config,
        models=models,
        interpreter=make_engine(config, models).interpreter,
        task=recording.metadata["task"],
        looks=looks,
        targets=targets,
        course=course,
        end=end,
        recorded=next((r.message for r in recording.messages if isinstance(r.message, Result)), None),
        frames=sorted(recording.frames, key=lambda frame: frame.stamp_ns),
    )


def _decision(result: Result | None) -> tuple[str, str, tuple[str, ...], int] | None:
    return None if result is None else (result.outcome.value, result.object, result.indistinct, result.looks)
