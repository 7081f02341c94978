"""The engine is a pure function of its events: what it asks for, when it gives up, and when it names an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
import pytest

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState, TaskLimits
from viewsep.geometry import angle_between, delaunay_edges, equidistant_sphere, spherical_direction
from viewsep.interfaces import Conclusion, Interpretation, NextView
from viewsep.interpretation.interpreter import PathInterpreter
from viewsep.kinematics import preset
from viewsep.messages import (
    CancelRequested,
    CandidateEstimate,
    Command,
    DeadlinePassed,
    Estimate,
    Event,
    FloatArray,
    FrameMissing,
    HypothesisViews,
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
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.planner import SeparatingViewPlanner
from viewsep.planning.reachable import ReachableViews
from viewsep.recordings.codec import to_bytes

T = TypeVar("T")


def at(azimuth_deg: float) -> FloatArray:
    return spherical_direction(np.radians(azimuth_deg), 0.0)


HOME = at(0)
STARTED = TaskStarted(0, 1, HOME)


def seen(azimuth_deg: float, stamp_ns: int = 1) -> PerceptReceived:
    return PerceptReceived(Percept(stamp_ns, stamp_ns, "none", np.zeros(1, np.float32), at(azimuth_deg)))


@dataclass
class ScriptedInterpreter:
    """Names `leaders` one after the other (the last one for ever); fresh at the updates listed. The state counts.

    `concludes` and `spreads` (radians, of every pose) follow each other likewise; with `probabilities` it has those.
    """

    leaders: Sequence[int] = (-1,)
    fresh_at: tuple[int, ...] = ()
    concludes: Sequence[Conclusion | None] = (None,)
    spreads: Sequence[float] = (0.0,)
    probabilities: bool = False
    state_type: type = int

    def start(self) -> int:
        return 0

    def update(self, state: int, percept: Percept) -> tuple[int, Interpretation]:
        rotation = np.eye(3)
        leader, concluded = _at(self.leaders, state), _at(self.concludes, state)
        spread = _at(self.spreads, state)
        ratings = [1.0 if k == leader else 8.0 for k in range(2)]
        candidates = tuple(
            CandidateEstimate(
                *(name, rating, 0.5, 0.1, 0.5, rotation, spread**2, True, 1, 0.5 if self.probabilities else None)
            )
            for name, rating in zip("ab", ratings, strict=True)
        )
        estimate = Estimate(percept.stamp_ns, -1, Phase.IDLE, candidates, 10, -1.0, None)
        rotations = np.stack([rotation, rotation])
        fresh = state in self.fresh_at
        return state + 1, Interpretation(estimate, rotations, True, np.ones(2, bool), leader, fresh, concluded)

    def hypotheses(self, state: int, stamp_ns: int) -> HypothesisViews:
        return HypothesisViews(stamp_ns, ("a", "b"), np.empty(0, int), np.empty((0, 3)), np.empty(0))


def _at(script: Sequence[T], step: int) -> T:
    return script[min(step, len(script) - 1)]


@dataclass
class ScriptedPlanner:
    """The start view and then `plans` one after the other (the last one for ever). The state counts."""

    first: NextView
    plans: Sequence[NextView]
    state_type: type = int

    def start(self, seed: int, view_direction: FloatArray) -> tuple[int, NextView]:
        return 0, self.first

    def next_view(self, state: int, view_direction: FloatArray, belief: Interpretation | None) -> tuple[int, NextView]:
        return state + 1, _at(self.plans, state)


START = NextView(at(10), Phase.STARTING)
EXPLORE = NextView(at(20), Phase.EXPLORING)
ARRIVE = NextView(at(90), Phase.APPROACHING, at(90), arrives=True)
STAY = NextView(None, Phase.EXPLORING)


def engine(
    leaders: Sequence[int] = (-1,),
    plans: Sequence[NextView] = (EXPLORE,),
    limits: TaskLimits | None = None,
    first: NextView = START,
    fresh_at: tuple[int, ...] = (),
) -> Engine:
    return Engine(ScriptedInterpreter(leaders, fresh_at), ScriptedPlanner(first, plans), limits)


def after(machine: Engine, *events: Event) -> tuple[EngineState, list[tuple[Command, ...]]]:
    """The last state and the commands of every step."""
    state, commands = machine.start(), []
    for event in events:
        state, issued = machine.step(state, event)
        commands.append(issued)
    return state, commands


def only_move(commands: tuple[Command, ...]) -> MoveTo:
    (command,) = commands
    assert isinstance(command, MoveTo)
    return command


# ---- purity, with the real interpreter and planner ----


def real_engine() -> Engine:
    nodes = equidistant_sphere(40)
    edges = delaunay_edges(nodes)
    rng = np.random.default_rng(0)
    models = [
        AspectGraph(
            name=name,
            directions=nodes,
            edges=edges,
            features=rng.random((40, 320), np.float32) / 320,
            thumbnails=np.zeros((40, 1, 1, 3), np.uint8),
            descriptor="cch",
            descriptor_parameters={},
            provenance=Provenance("", "", ""),
        )
        for name in ("a", "b")
    ]
    planner = SeparatingViewPlanner(models, ReachableViews.of(preset("gimbal")))
    return Engine(PathInterpreter(models, ColourCooccurrence()), planner, TaskLimits(max_looks=30))


def drive(machine: Engine, looks: int) -> tuple[list[Event], list[EngineState], list[tuple[Command, ...]]]:
    """Events of a rig that arrives at once and looks wherever it was sent."""
    rng = np.random.default_rng(1)
    events: list[Event] = [TaskStarted(0, 5, HOME)]
    states: list[EngineState] = []
    commands: list[tuple[Command, ...]] = []
    stamp_ns = 0
    while events[len(states) :] and sum(isinstance(event, PerceptReceived) for event in events) < looks:
        for event in events[len(states) :]:
            state, issued = machine.step(states[-1] if states else machine.start(), event)
            states.append(state)
            commands.append(issued)
        stamp_ns += 1000
        move = states[-1].move
        if move is not None and states[-1].result is None:
            percept = Percept(stamp_ns, stamp_ns, "cch", rng.random(320, np.float32) / 320, move.view_direction)
            events += [PerceptReceived(percept), MoveSettled(stamp_ns + 1, move.command_id)]
        elif states[-1].result is None:
            here = states[-1].view_direction
            assert here is not None
            feature = rng.random(320, np.float32) / 320
            events.append(PerceptReceived(Percept(stamp_ns, stamp_ns, "cch", feature, here)))
    return events[: len(states)], states, commands


def outputs(states: Sequence[EngineState], commands: Sequence[tuple[Command, ...]]) -> list[bytes]:
    out: list[bytes] = []
    for state, issued in zip(states, commands, strict=True):
        out += [to_bytes(message) for message in (state.estimate, state.result, *issued) if message is not None]
    return out


def test_the_same_events_give_the_same_bytes() -> None:
    events, states, commands = drive(real_engine(), 40)
    assert states[-1].looks >= 20
    again = real_engine()
    state, others, other_commands = again.start(), [], []
    for event in events:
        state, issued = again.step(state, event)
        others.append(state)
        other_commands.append(issued)
    assert outputs(others, other_commands) == outputs(states, commands)


def test_earlier_states_stay_as_they_were_and_can_be_stepped_from_again() -> None:
    machine = real_engine()
    events, states, commands = drive(machine, 40)
    before = outputs(states, commands)
    for i in (3, 10, len(events) // 2):
        again, issued = machine.step(states[i - 1], events[i])
        assert outputs([again], [issued]) == outputs(states[i : i + 1], commands[i : i + 1])
        machine.step(states[i - 1], CancelRequested(1, "another branch"))
    assert outputs(states, commands) == before


# ---- start ----


def test_a_task_starts_with_a_move_to_the_start_view() -> None:
    state, commands = after(engine(), STARTED)
    move = only_move(commands[0])
    assert (move.command_id, move.purpose) == (0, Phase.STARTING)
    np.testing.assert_array_equal(move.view_direction, at(10))
    assert state.phase is Phase.STARTING


def test_a_planner_that_starts_where_it_is_explores_at_once() -> None:
    state, commands = after(engine(first=NextView(None, Phase.STARTING)), STARTED)
    assert only_move(commands[0]).purpose is Phase.EXPLORING
    assert state.phase is Phase.EXPLORING


def test_nothing_happens_without_a_task() -> None:
    machine = engine()
    idle = machine.start()
    for event in (seen(0), MoveSettled(1, 0), MoveFailed(1, 0, "x"), DeadlinePassed(1), CancelRequested(1, "x")):
        state, commands = machine.step(idle, event)
        assert state is idle
        assert commands == ()


def test_percepts_on_the_way_to_the_start_view_are_ignored() -> None:
    state, commands = after(engine(), STARTED, seen(5), seen(9))
    assert commands[1:] == [(), ()]
    assert (state.looks, state.travel_rad, state.estimate) == (0, 0.0, None)
    state, commands = after(engine(), STARTED, seen(5), MoveSettled(2, 0), seen(10))
    assert only_move(commands[2]).purpose is Phase.EXPLORING
    assert state.looks == 1


# ---- moves ----


def test_only_the_current_move_can_settle_or_fail() -> None:
    machine = engine()
    state, _ = after(machine, STARTED)
    for event in (MoveSettled(1, 7), MoveFailed(1, 7, "late"), MoveSettled(1, -1)):
        unchanged, commands = machine.step(state, event)
        assert unchanged is state
        assert commands == ()


def test_a_failed_move_is_tried_again_under_a_new_number_until_the_limit() -> None:
    events: list[Event] = [STARTED, MoveFailed(1, 0, "jammed"), MoveFailed(2, 1, "jammed"), MoveFailed(3, 2, "jammed")]
    state, commands = after(engine(limits=TaskLimits(max_failed_moves=3)), *events)
    assert [only_move(issued).command_id for issued in commands[:3]] == [0, 1, 2]
    assert all(only_move(issued).purpose is Phase.STARTING for issued in commands[:3])
    assert all((only_move(issued).view_direction == at(10)).all() for issued in commands[:3])
    assert isinstance(commands[3][0], Stop)
    assert state.result is not None
    assert state.result.outcome is Outcome.FAILED
    assert state.result.reason == "3 moves failed in a row: jammed"


def test_only_failures_in_a_row_count() -> None:
    events: list[Event] = [STARTED]
    for i in range(0, 12, 2):
        events += [MoveFailed(i, i, "jammed"), MoveSettled(i + 1, i + 1)]
    state, _ = after(engine(limits=TaskLimits(max_failed_moves=2)), *events)
    assert state.result is None
    assert state.failed_moves == 0


def test_command_numbers_never_repeat() -> None:
    _, _, commands = drive(real_engine(), 40)
    numbers = [command.command_id for issued in commands for command in issued]
    assert numbers == list(range(len(numbers)))


# ---- giving up ----


def test_missing_frames_in_a_row_end_the_task() -> None:
    missing = FrameMissing(5, "no light")
    machine = engine(limits=TaskLimits(max_missing_frames=3))
    state, _ = after(machine, STARTED, MoveSettled(1, 0), missing, missing, seen(10), missing, missing)
    assert state.result is None
    state, (command,) = machine.step(state, missing)
    assert isinstance(command, Stop)
    assert state.result is not None
    assert (state.result.outcome, state.result.reason) == (Outcome.FAILED, "3 frames missing in a row: no light")


def test_missing_frames_on_the_way_to_the_start_count_too() -> None:
    missing = FrameMissing(5, "no light")
    state, _ = after(engine(limits=TaskLimits(max_missing_frames=2)), STARTED, missing, missing)
    assert state.result is not None


def test_the_deadline_leaves_it_undecided() -> None:
    state, commands = after(engine(), STARTED, MoveSettled(1, 0), seen(10), DeadlinePassed(9))
    assert state.result is not None
    assert (state.result.outcome, state.result.object, state.result.stamp_ns) == (Outcome.UNDECIDED, "", 9)
    assert [name for name, _ in state.result.ratings] == ["a", "b"]
    assert isinstance(commands[-1][0], Stop)


def test_a_cancelled_task_failed_and_says_why() -> None:
    state, commands = after(engine(), STARTED, CancelRequested(9, "lunch"))
    assert state.result is not None
    assert (state.result.outcome, state.result.reason) == (Outcome.FAILED, "cancelled: lunch")
    assert (state.result.looks, state.result.ratings) == (0, ())
    assert isinstance(commands[-1][0], Stop)


def test_nothing_changes_after_the_result() -> None:
    machine = engine()
    done, _ = after(machine, STARTED, MoveSettled(1, 0), seen(10), DeadlinePassed(9))
    late: list[Event] = [seen(80), MoveSettled(10, 1), MoveFailed(10, 1, "x"), FrameMissing(10, "x")]
    for event in [*late, DeadlinePassed(11), CancelRequested(12, "x")]:
        state, commands = machine.step(done, event)
        assert state is done
        assert commands == ()


def test_a_new_task_starts_from_nothing() -> None:
    machine = engine()
    done, _ = after(machine, STARTED, MoveSettled(1, 0), seen(10), DeadlinePassed(9))
    again, commands = machine.step(done, STARTED)
    fresh, expected = machine.step(machine.start(), STARTED)
    assert [to_bytes(c) for c in commands] == [to_bytes(c) for c in expected]
    for field in fields(EngineState):
        if field.name not in ("move", "move_plan", "view_direction"):
            assert getattr(again, field.name) == getattr(fresh, field.name)


def test_spent_looks_leave_it_undecided() -> None:
    machine = engine(limits=TaskLimits(max_looks=4))
    state, _ = after(machine, STARTED, MoveSettled(1, 0), *(seen(10 * i) for i in range(1, 4)))
    assert state.result is None
    state, commands = machine.step(state, seen(40))
    assert state.result is not None
    assert (state.result.outcome, state.result.looks) == (Outcome.UNDECIDED, 4)
    assert isinstance(commands[0], Stop)


@pytest.mark.parametrize("settled", [False, True], ids=["on the way to the start", "before it turned further"])
def test_a_frame_that_is_not_interpreted_is_not_missing_either(settled: bool) -> None:
    events: list[Event] = [STARTED, MoveSettled(1, 0), seen(10)] if settled else [STARTED]
    for _ in range(5):
        events += [FrameMissing(5, "no light"), seen(10)]
    state, _ = after(engine(limits=TaskLimits(max_missing_frames=2)), *events)
    assert state.result is None


# ---- looking ----


def test_a_view_is_looked_at_again_only_after_turning() -> None:
    machine = engine(limits=TaskLimits(look_every_rad=float(np.radians(4.0))))
    state, commands = after(machine, STARTED, MoveSettled(1, 0), seen(10), seen(10), seen(12), seen(13.9))
    assert state.looks == 1
    assert commands[-3:] == [(), (), ()]
    state, _ = machine.step(state, seen(14.1))
    assert state.looks == 2


def test_a_rig_that_stands_and_waits_looks_at_the_same_view_again() -> None:
    machine = engine(plans=[STAY])
    state, commands = after(machine, STARTED, MoveSettled(1, 0), seen(10), seen(10), seen(10))
    assert state.looks == 3
    assert commands[1:] == [(), (), (), ()]
    assert state.dwelling


def test_estimates_carry_looks_travel_phase_and_comparisons() -> None:
    state, _ = after(engine(), STARTED, MoveSettled(1, 0), seen(10), seen(20), seen(50))
    assert state.estimate is not None
    assert (state.estimate.iteration, state.estimate.phase) == (3, Phase.EXPLORING)
    assert np.degrees(state.estimate.travel_rad) == pytest.approx(40.0)
    assert state.comparisons == 30


# ---- judging ----

TO_THE_VIEW: list[Event] = [STARTED, MoveSettled(1, 0), seen(10)]
WITHIN_20_TWICE = TaskLimits(judge_within_rad=float(np.radians(20.0)), confirming_looks=2)


def test_a_leader_on_the_way_to_the_separating_view_is_not_named() -> None:
    machine = engine(leaders=[0], plans=[ARRIVE], limits=WITHIN_20_TWICE)
    state, commands = after(machine, *TO_THE_VIEW, *(seen(azimuth) for azimuth in (30, 50, 70, 80, 89)))
    assert state.result is None
    assert only_move(commands[1]).purpose is Phase.APPROACHING
    assert state.estimate is not None
    assert state.estimate.target is not None
    np.testing.assert_array_equal(state.estimate.target, at(90))


def test_at_the_separating_view_the_rig_waits_for_a_look_before_it_goes_on() -> None:
    machine = engine(plans=[ARRIVE, EXPLORE], limits=WITHIN_20_TWICE)
    state, commands = after(machine, *TO_THE_VIEW, seen(90), MoveSettled(2, 1))
    assert (state.phase, state.dwelling, commands[-1]) == (Phase.JUDGING, True, ())
    state, commands = after(machine, *TO_THE_VIEW, seen(90), MoveSettled(2, 1), seen(90))
    assert only_move(commands[-1]).purpose is Phase.EXPLORING
    assert (state.looks, state.dwelling) == (3, False)


def test_the_leader_is_named_after_confirming_looks_within_reach_of_the_separating_view() -> None:
    machine = engine(leaders=[0], plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE)
    state, commands = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), seen(90))
    assert state.result is None
    state, commands = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), seen(90), seen(75))
    assert state.result is not None
    assert (state.result.outcome, state.result.object) == (Outcome.IDENTIFIED, "a")
    assert "8.0 times better than that of b" in state.result.reason
    assert isinstance(commands[-1][0], Stop)
    assert state.estimate is not None
    assert state.estimate.phase is Phase.DONE


def test_looks_too_far_from_the_separating_view_confirm_nothing() -> None:
    machine = engine(leaders=[0], plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE)
    state, _ = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), seen(90), seen(60), seen(40), seen(69.9))
    assert state.result is None
    assert float(angle_between(at(69.9), at(90))) > WITHIN_20_TWICE.judge_within_rad
    state, _ = machine.step(state, seen(70.1))
    assert state.result is not None


@pytest.mark.parametrize("leaders", [[0, 0, 1, 0, 1], [0, 0, -1, 0, -1]], ids=["another leads", "nobody leads"])
def test_confirming_looks_must_follow_each_other(leaders: list[int]) -> None:
    machine = engine(leaders=leaders, plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE)
    state, _ = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), *(seen(90) for _ in range(4)))
    assert state.looks == 5
    assert state.result is None


def test_nobody_is_named_however_long_nobody_leads() -> None:
    machine = engine(leaders=[-1], plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE)
    state, _ = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), *(seen(90) for _ in range(10)))
    assert state.result is None


def test_a_separating_view_chosen_before_all_was_lost_decides_nothing() -> None:
    machine = engine(leaders=[0], plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE, fresh_at=(1,))
    state, _ = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), *(seen(90) for _ in range(6)))
    assert state.separating_view is None
    assert state.result is None


# ---- conclusions ----

SURE = Conclusion(Outcome.IDENTIFIED, "it is most probable")
NOBODY = Conclusion(Outcome.UNKNOWN, "it is most probable")
TWINS = Conclusion(Outcome.INDISTINGUISHABLE, "no view tells them apart", (0, 1), at(45))
LOOKING: list[Event] = [STARTED, MoveSettled(1, 0)]
WITHIN_5 = TaskLimits(pose_tolerance_rad=float(np.radians(5.0)), max_looks=6)


def sure(
    concludes: Sequence[Conclusion | None] = (SURE,),
    spreads_deg: Sequence[float] = (12.0,),
    plans: Sequence[NextView] = (EXPLORE,),
    limits: TaskLimits = WITHIN_5,
    leader: int = 1,
) -> Engine:
    spreads = [float(np.radians(spread)) for spread in spreads_deg]
    interpreter = ScriptedInterpreter((leader,), (), concludes, spreads, probabilities=True)
    return Engine(interpreter, ScriptedPlanner(START, plans), limits)


def ended(state: EngineState) -> Result:
    assert state.result is not None
    assert state.phase is Phase.DONE
    return state.result


def test_whoever_is_sure_is_heard_at_once_wherever_it_looks() -> None:
    state, commands = after(sure([None, SURE], limits=TaskLimits()), *LOOKING, seen(10), seen(20))
    result = ended(state)
    assert (result.outcome, result.object, result.reason) == (Outcome.IDENTIFIED, "b", "it is most probable")
    assert (result.looks, result.indistinct, result.telling_view) == (2, (), None)
    assert result.pose_spread_rad == pytest.approx(np.radians(12.0))
    assert [isinstance(issued[-1], Stop) for issued in commands[-2:] if issued] == [True]


def test_a_rating_alone_does_not_know_how_well_the_pose_is_known() -> None:
    machine = engine(leaders=[0], plans=[ARRIVE, STAY], limits=WITHIN_20_TWICE)
    state, _ = after(machine, *TO_THE_VIEW, MoveSettled(2, 1), seen(90), seen(75))
    assert ended(state).pose_spread_rad is None


def test_a_name_waits_until_its_pose_is_known() -> None:
    machine = sure(spreads_deg=[12.0, 8.0, 5.1, 4.9])
    state, commands = after(machine, *LOOKING, seen(10), seen(20), seen(30))
    assert (state.result, commands[-1], state.looks) == (None, (), 3)
    state, _ = machine.step(state, seen(40))
    result = ended(state)
    assert (result.outcome, result.object, result.reason) == (Outcome.IDENTIFIED, "b", "it is most probable")
    assert result.pose_spread_rad == pytest.approx(np.radians(4.9))


def test_a_name_that_is_not_sure_any_more_waits_no_longer() -> None:
    machine = sure([SURE, None], spreads_deg=[12.0, 4.0])
    state, _ = after(machine, *LOOKING, seen(10), seen(20), DeadlinePassed(9))
    assert (ended(state).outcome, ended(state).object) == (Outcome.UNDECIDED, "")


@pytest.mark.parametrize("spent", ["looks", "time"])
def test_a_name_that_waits_when_the_budget_is_spent_is_said_all_the_same(spent: str) -> None:
    events: list[Event] = [*LOOKING, *(seen(10 * i, i) for i in range(1, 6))]
    state, _ = after(sure(), *events)
    assert state.result is None
    state, commands = after(sure(), *events, seen(60, 6) if spent == "looks" else DeadlinePassed(6))
    result = ended(state)
    assert (result.outcome, result.object, result.stamp_ns) == (Outcome.IDENTIFIED, "b", 6)
    assert result.reason == "it is most probable; the budget was spent before its pose was sure"
    assert result.pose_spread_rad == pytest.approx(np.radians(12.0))
    assert isinstance(commands[-1][0], Stop)


def test_a_planner_that_sees_no_use_in_going_on_ends_it() -> None:
    plans = [EXPLORE, NextView(None, Phase.EXPLORING, conclusion=TWINS)]
    machine = sure([None], plans=plans, leader=-1)
    state, commands = after(machine, *LOOKING, seen(10, 4), MoveSettled(5, 1))
    result = ended(state)
    assert (result.outcome, result.object, result.reason) == (Outcome.INDISTINGUISHABLE, "", "no view tells them apart")
    assert (result.indistinct, result.stamp_ns) == (("a", "b"), 4)
    assert result.telling_view is not None
    np.testing.assert_array_equal(result.telling_view, at(45))
    (stop,) = commands[-1]
    assert (type(stop), getattr(stop, "reason", "")) == (Stop, "indistinguishable")


def test_a_planner_that_has_seen_nothing_yet_concludes_nothing() -> None:
    machine = sure([None], plans=[NextView(None, Phase.EXPLORING, conclusion=TWINS)], leader=-1)
    state, commands = after(machine, *LOOKING)
    assert (state.result, commands[-1], state.dwelling) == (None, (), True)
    state, _ = machine.step(state, seen(10))
    assert ended(state).outcome is Outcome.INDISTINGUISHABLE


def test_a_name_that_waits_is_said_when_the_planner_sees_no_use_in_going_on() -> None:
    hopeless = Conclusion(Outcome.INDISTINGUISHABLE, "no view says more about its pose", (0, 1), at(45))
    plans = [EXPLORE, NextView(None, Phase.EXPLORING, conclusion=hopeless)]
    state, _ = after(sure(plans=plans), *LOOKING, seen(10), MoveSettled(2, 1))
    result = ended(state)
    assert (result.outcome, result.object) == (Outcome.IDENTIFIED, "b")
    assert result.reason == "it is most probable; no view says more about its pose"
    assert (result.indistinct, result.telling_view) == ((), None)


def test_an_unknown_object_has_no_pose_to_wait_for() -> None:
    state, commands = after(sure([NOBODY], spreads_deg=[120.0], leader=-1), *LOOKING, seen(10))
    result = ended(state)
    assert (result.outcome, result.object, result.reason) == (Outcome.UNKNOWN, "", "it is most probable")
    assert (result.looks, [name for name, _ in result.ratings]) == (1, ["a", "b"])
    assert isinstance(commands[-1][0], Stop)


def test_a_cancelled_task_failed_even_where_a_name_waits() -> None:
    state, _ = after(sure(), *LOOKING, seen(10), CancelRequested(9, "lunch"))
    assert (ended(state).outcome, ended(state).object) == (Outcome.FAILED, "")


def test_a_name_that_waits_survives_being_saved() -> None:
    machine = sure(spreads_deg=[12.0, 4.0])
    state, _ = after(machine, *LOOKING, seen(10))
    again = machine.restore(machine.save(state))
    assert machine.save(again) == machine.save(state)
    assert to_bytes(ended(machine.step(again, seen(20))[0])) == to_bytes(ended(machine.step(state, seen(20))[0]))
    done, _ = machine.step(state, seen(20))
    assert machine.save(machine.restore(machine.save(done))) == machine.save(done)
