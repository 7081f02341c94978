"""Recorded percepts through other methods: the recorded one takes the recorded course, others their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from golden_recording import TRUTH, USED, golden, until_look, where, with_message, without_message

from viewsep.cli.what_if import methods_of
from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.engine.engine import Engine
from viewsep.engine.state import TaskLimits
from viewsep.errors import BadInput, BadRecording
from viewsep.geometry import spherical_direction
from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import (
    CandidateEstimate,
    Estimate,
    FloatArray,
    HypothesisViews,
    Message,
    MoveFailed,
    MoveSettled,
    MoveTo,
    Outcome,
    Percept,
    PerceptReceived,
    Phase,
    Result,
    Stop,
    TaskStarted,
)
from viewsep.plugins import make_descriptor
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.replay import FEATURE_TOLERANCE, restore
from viewsep.recordings.tally import Tally, is_right, tally
from viewsep.recordings.what_if import Course, Ending, Shadow, recorded_course, what_if

FOLDER = Path(__file__).parents[1] / "golden"
CANDIDATES = ["product_7", TRUTH]


def course(recording: Recording, interpreter: str | None = None, planner: str | None = None) -> Course:
    """Of one other method; without any, of the recorded one."""
    config, models = restore(recording)
    (method,) = methods_of([interpreter] if interpreter else [], [planner] if planner else [], None)
    return what_if(recording, method.instead(config), models)


# the recorded method


@pytest.mark.parametrize("name", ["v1", "v2"])
def test_the_recorded_method_takes_the_recorded_course(name: str) -> None:
    recording = read_recording(FOLDER / f"{name}.mcap")
    recorded, again = recorded_course(recording), course(recording)
    assert (recorded.ending, recorded.object, recorded.looks) == (Ending.IDENTIFIED, TRUTH, USED)
    assert again.travel_rad == pytest.approx(recorded.travel_rad, rel=1e-6)  # the last digits belong to the processor
    assert replace(again, travel_rad=recorded.travel_rad, reason=recorded.reason) == recorded
    assert again.agrees(recorded) is True


def test_naming_the_recorded_plugins_changes_nothing() -> None:
    assert course(golden(), "path", "separating") == course(golden())


def test_it_takes_it_up_to_where_a_recording_ends() -> None:
    short = until_look(golden(), 20)
    recorded, again = recorded_course(short), course(short)
    assert (recorded.ending, recorded.object, recorded.looks) == (Ending.RECORDING_ENDS, "", 20)
    assert replace(again, travel_rad=recorded.travel_rad) == recorded
    assert 0 < again.comparisons < course(golden()).comparisons
    assert again.agrees(recorded) is None


def test_nothing_but_the_start_is_a_course_too() -> None:
    first = where(golden(), "percept")[0]
    course_ = course(replace(golden(), messages=golden().messages[:first]))
    assert course_ == Course(Ending.RECORDING_ENDS, "", course_.reason, 0, 0.0, 0, "", 0)


# other methods


@pytest.mark.parametrize("interpreter", ["path:variant=initial", "path:alignment=wahba", "path:rated_by=w1"])
def test_another_method_takes_another_course(interpreter: str) -> None:
    recorded, other = course(golden()), course(golden(), interpreter)
    assert replace(other, reason="") != replace(recorded, reason="")
    assert course(golden(), interpreter) == other  # the same again


def test_without_a_planner_the_rating_decides_wherever_the_path_leads() -> None:
    found = course(golden(), planner="off")
    assert (found.ending, found.object) == (Ending.IDENTIFIED, TRUTH)
    assert found.looks > USED  # it looks at what repeats as well, and on the way to the start view
    late = course(golden(), planner="off:turned_deg=180")
    assert late.ending is Ending.RECORDING_ENDS


def test_a_budget_ends_as_undecided_and_not_with_the_recording() -> None:
    config, models = restore(golden())
    budget = config.model_copy(update={"task": config.task.model_copy(update={"max_looks": 10})})
    found = what_if(golden(), budget, models)
    assert (found.ending, found.looks) == (Ending.UNDECIDED, 10)
    assert "within 10 looks" in found.reason


def test_lost_messages_leave_a_course() -> None:
    place = where(golden(), "command")[4]
    torn = without_message(golden(), place)
    found = course(replace(torn, gaps=frozenset({place})))
    assert found.looks > 20
    assert found.leading in CANDIDATES


def test_a_recording_without_its_beginning_is_refused() -> None:
    with pytest.raises(BadRecording, match="the beginning of the task is not in the recording: give its first file"):
        course(without_message(golden(), where(golden(), "event")[0]))


# other descriptors


@dataclass(frozen=True)
class Watched(ColourCooccurrence):
    """The descriptor, and what it made of the pictures."""

    seen: ClassVar[list[Any]] = []

    def describe(self, image: Any, mask: Any) -> Any:
        self.seen.append(super().describe(image, mask))
        return self.seen[-1]


def test_the_same_descriptor_sees_the_same_in_the_pictures() -> None:
    config, models = restore(golden())
    found, recorded = what_if(golden(), config, models, Watched()), course(golden())
    percepts = [r.message.percept for r in golden().messages if isinstance(r.message, PerceptReceived)]
    similar = [
        float(Watched().similarity(seen, percept.feature[None])[0])
        for seen, percept in zip(Watched.seen, percepts, strict=False)
    ]
    assert len(similar) > recorded.looks
    assert min(similar) > FEATURE_TOLERANCE  # JPEG loses detail
    assert max(similar) < 1.0
    assert (found.leading, recorded.leading) == (TRUTH, TRUTH)
    assert abs(found.looks - recorded.looks) <= 3


def test_pictures_are_needed_for_that() -> None:
    config, models = restore(golden())
    descriptor = make_descriptor(config.descriptor)
    with pytest.raises(BadRecording, match="holds no pictures, and another descriptor can be tried on pictures only"):
        what_if(replace(golden(), frames=()), config, models, descriptor)
    with pytest.raises(BadRecording, match=r"the picture of the percept at \d+ ns is not in the recording"):
        what_if(replace(golden(), frames=golden().frames[:9]), config, models, descriptor)


class Blind:
    """A descriptor that finds no object in any picture."""

    name, size = "blind", 320

    def describe(self, image: Any, mask: Any) -> Any:
        raise BadInput("no pixel is on the object")


def test_a_picture_that_shows_no_object_is_a_missing_frame() -> None:
    config, models = restore(golden())
    found = what_if(golden(), config, models, Blind())  # type: ignore[arg-type]
    assert (found.ending, found.looks) == (Ending.FAILED, 0)
    assert "20 frames missing in a row, for 5.1 s: no pixel is on the object" in found.reason


# when the moves of a shadow arrive


def view(azimuth_deg: float) -> FloatArray:
    """A view direction on the equator."""
    return spherical_direction(np.radians(azimuth_deg), 0.0)


@dataclass(frozen=True, slots=True)
class Nothing:
    """The state of those that remember nothing."""


class Toy:
    """An interpreter and a planner in one: `plan` is what is asked for next, `fresh` whether it has just begun."""

    state_type = Nothing

    def __init__(self, plan: NextView) -> None:
        self.plan, self.fresh, self.asked = plan, False, 0

    def start(self, *_: Any) -> Any:
        return (Nothing(), NextView(None, Phase.STARTING)) if _ else Nothing()

    def next_view(self, state: Nothing, here: FloatArray, belief: Interpretation | None) -> tuple[Nothing, NextView]:
        self.asked += 1
        return state, self.plan

    def update(self, state: Nothing, percept: Percept) -> tuple[Nothing, Interpretation]:
        candidates = tuple(CandidateEstimate(n, r, 0, 0, 0, np.eye(3), 0, True, 1) for n, r in (("a", 1.0), ("b", 9.0)))
        estimate = Estimate(percept.stamp_ns, 0, Phase.EXPLORING, candidates, 1, 0.0, None)
        return state, Interpretation(estimate, np.eye(3)[None], True, np.ones(2, bool), 0, self.fresh)

    def hypotheses(self, state: Any, stamp_ns: int) -> HypothesisViews:
        raise NotImplementedError


def shadow_with(plan: NextView) -> tuple[Shadow, Toy]:
    toy = Toy(plan)
    shadow = Shadow(Engine(toy, toy, TaskLimits(judge_within_rad=float(np.radians(20.0)), confirming_looks=2)))
    shadow.hear(TaskStarted(0, 1, view(0)))
    return shadow, toy


def show(shadow: Shadow, stamp_ns: int, azimuth_deg: float) -> None:
    shadow.hear(PerceptReceived(Percept(stamp_ns, stamp_ns, "toy", np.zeros(1, np.float32), view(azimuth_deg))))


def exploring(azimuth_deg: float) -> NextView:
    return NextView(view(azimuth_deg), Phase.EXPLORING)


def separating(azimuth_deg: float) -> NextView:
    return NextView(view(azimuth_deg), Phase.APPROACHING, view(azimuth_deg), arrives=True)


def test_an_exploration_goes_on_with_every_percept_wherever_it_is() -> None:
    shadow, toy = shadow_with(exploring(-170))
    for look in range(1, 6):
        show(shadow, look, 10.0 * look)
    assert toy.asked == 5  # at the start, and after each percept but the last, which waits for what follows
    shadow.hear(MoveSettled(6, 99))
    assert toy.asked == 6


def test_a_separating_view_is_reached_where_the_path_comes_near_it() -> None:
    shadow, toy = shadow_with(separating(100))
    for look, azimuth in enumerate((0, 30, 60, 79), 1):
        show(shadow, look, azimuth)
        assert shadow.state.phase is Phase.APPROACHING
    assert (toy.asked, shadow.state.result) == (1, None)
    show(shadow, 5, 81)
    show(shadow, 6, 90)  # judged, as 81 was within 20 degrees
    assert shadow.state.separating_view is not None
    assert shadow.state.leads == (0, 1)
    show(shadow, 7, 99)
    assert shadow.state.result is not None
    assert (shadow.state.result.outcome, shadow.state.result.object) == (Outcome.IDENTIFIED, "a")


def test_a_separating_view_that_is_never_shown_decides_nothing() -> None:
    shadow, toy = shadow_with(separating(180))
    for look in range(1, 40):
        show(shadow, look, 80.0 + 40.0 * (look % 3))
    assert shadow.state.looks == 39
    assert (toy.asked, shadow.state.result, shadow.state.separating_view) == (1, None, None)


def test_new_hypotheses_end_the_wait_for_it() -> None:
    shadow, toy = shadow_with(separating(180))
    show(shadow, 1, 10)
    show(shadow, 2, 20)
    assert toy.asked == 1
    toy.fresh, toy.plan = True, exploring(-90)
    show(shadow, 3, 30)
    show(shadow, 4, 40)
    assert toy.asked == 2
    assert shadow.state.move is not None
    assert np.array_equal(shadow.state.move.view_direction, view(-90))


def test_a_move_of_both_arrives_when_the_recorded_one_does() -> None:
    shadow, toy = shadow_with(exploring(10))
    shadow.hear(MoveTo(7, view(10), Phase.EXPLORING))
    for look in range(1, 4):
        show(shadow, look, 10)
    assert toy.asked == 1
    shadow.hear(MoveSettled(4, 6))  # an abandoned one
    assert toy.asked == 1
    shadow.hear(MoveSettled(4, 7))
    assert toy.asked == 2
    show(shadow, 5, 20)
    shadow.hear(Stop(8, "identified"))
    show(shadow, 6, 30)
    assert toy.asked == 3


def test_a_move_of_both_fails_when_the_recorded_one_does() -> None:
    shadow, _ = shadow_with(exploring(10))
    for command in (7, 8, 9):
        shadow.hear(MoveTo(command, view(10), Phase.EXPLORING))
        shadow.hear(MoveFailed(command, command, "stuck"))
    assert shadow.state.result is not None
    assert shadow.state.result.reason == "3 moves failed in a row: stuck"


def test_the_failure_of_another_move_is_none_of_its_own() -> None:
    shadow, toy = shadow_with(exploring(10))
    for command in (7, 8, 9):
        shadow.hear(MoveTo(command, view(50), Phase.EXPLORING))
        shadow.hear(MoveFailed(command, command, "stuck"))
    assert (shadow.state.result, shadow.state.failed_moves, toy.asked) == (None, 0, 1)


def test_after_a_gap_no_recorded_move_is_waited_for() -> None:
    shadow, toy = shadow_with(exploring(10))
    shadow.hear(MoveTo(7, view(10), Phase.EXPLORING))
    show(shadow, 1, 5)
    shadow.lose()
    show(shadow, 2, 20)
    assert toy.asked == 2


# many recordings


def ended(ending: Ending, named: str = "", looks: int = 10) -> Course:
    return Course(ending, named, "", looks, looks / 10, 0, named, 1)


def test_a_tally_counts_answers_and_agreement() -> None:
    right, wrong = ended(Ending.IDENTIFIED, "tea", 20), ended(Ending.IDENTIFIED, "decaf", 40)
    undecided, ends = ended(Ending.UNDECIDED, looks=400), ended(Ending.RECORDING_ENDS, looks=99)
    unknown, twins = ended(Ending.UNKNOWN), replace(ended(Ending.INDISTINGUISHABLE), indistinct=("decaf", "tea"))
    courses = [right, wrong, right, undecided, ended(Ending.FAILED), ends, unknown, twins, twins]
    recorded = [right, right, wrong, undecided, right, right, unknown, twins, replace(twins, indistinct=("tea", "x"))]
    assert tally(courses, recorded, ["tea", "tea", "", *["tea"] * 6]) == Tally(
        right=1,
        wrong=1,
        unchecked=1,
        unknown=1,
        indistinguishable=2,
        undecided=1,
        failed=1,
        recording_ends=1,
        agree=4,
        differ=4,
        looks_median=20,
        travel_median_rad=2.0,
    )
    nobody = tally([undecided], [ends], ["tea"])
    assert np.isnan([nobody.looks_median, nobody.travel_median_rad]).all()
    assert (nobody.agree, nobody.differ) == (0, 0)
    assert [is_right(course, "tea") for course in (right, wrong, ends, unknown)] == [True, False, None, None]


@pytest.mark.parametrize("outcome", Outcome)
def test_every_outcome_is_an_ending(outcome: Outcome) -> None:
    def other(result: Message) -> Message:
        assert isinstance(result, Result)
        return replace(result, outcome=outcome, object="", indistinct=("tea", "decaf"))

    found = recorded_course(with_message(golden(), where(golden(), "result")[0], other))
    assert (found.ending.value, found.indistinct) == (outcome.value, ("decaf", "tea"))
