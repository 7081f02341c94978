"""Objects that were not learned and look like a candidate from most sides: what is seen before a name is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from painted import POLE, held, interpreter, looks, model, seen, unit

from viewsep.engine.engine import Engine
from viewsep.engine.state import TaskLimits
from viewsep.geometry import axis_rotation, fibonacci_sphere
from viewsep.interfaces import Interpretation
from viewsep.interpretation.filter_state import FilterOptions, Lost
from viewsep.kinematics import preset
from viewsep.messages import FloatArray, MoveSettled, MoveTo, Outcome, PerceptReceived, Result, TaskStarted
from viewsep.planning.information import InformationPlanner
from viewsep.planning.reachable import SIDE_RAD, ReachableViews, shows

A, B = model("a", 1, noise=0.05, disturbed=0.05), model("b", 2, noise=0.05, disturbed=0.05)
RIGS = {name: ReachableViews.of(preset(name)) for name in ("gimbal", "turntable")}
CAP = unit(np.array([[x, y, 1.0] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]))  # around the pole


def looked_at(share: float, rig: str = "gimbal") -> tuple[Result, FloatArray]:
    """How a task with candidate a ends on a rig, and the (L, 3) views it was looked at from."""
    reachable, rotation = RIGS[rig], held(3)
    engine = Engine(interpreter(A, B), InformationPlanner((A, B), reachable), TaskLimits(look_around=share), reachable)
    views = [reachable.directions[0]]
    state, commands = engine.step(engine.start(), TaskStarted(0, 1, views[0]))
    for stamp in range(1, 200):
        for move in (command for command in commands if isinstance(command, MoveTo)):
            views.append(move.view_direction)
            state, commands = engine.step(state, MoveSettled(stamp, move.command_id))
        (percept,) = seen(views[-1][None], rotation, 1)
        state, answered = engine.step(state, PerceptReceived(percept))
        commands = answered or commands
        if state.result is not None:
            return state.result, np.array(views)
    raise AssertionError("no result")


@pytest.mark.parametrize("rig", sorted(RIGS))
def test_a_name_waits_until_so_much_of_what_the_rig_can_show_was_seen(rig: str) -> None:
    counts = []
    for share in (0.0, 0.5, 0.9):
        result, views = looked_at(share, rig)
        assert (result.outcome, result.object) == (Outcome.IDENTIFIED, "a")
        unseen = RIGS[rig].unseen(views)
        assert len(unseen) <= (1.0 - share) * len(RIGS[rig].directions)
        counts.append(len(views))
    assert counts[0] < counts[-1]


def test_what_faces_a_look_is_seen_and_the_rest_is_not() -> None:
    reachable = RIGS["gimbal"]
    unseen = reachable.unseen(POLE[None])
    assert (unseen @ POLE <= np.cos(SIDE_RAD)).all()
    assert len(unseen) / len(reachable.directions) == pytest.approx(0.75, abs=0.02)  # a cap of 60 degrees is a quarter
    assert len(reachable.unseen(fibonacci_sphere(20))) == 0
    assert len(reachable.unseen(np.empty((0, 3)))) == len(reachable.directions)
    assert shows(POLE[None], -POLE[None]).tolist() == [[False]]


def looked_around(rotation: FloatArray, patch: FloatArray, paint: int, options: FilterOptions) -> Interpretation:
    """What is believed of an object like a, but painted otherwise around the pole, where it is looked at in between."""
    machine = interpreter(A, B, options=options)
    state = machine.start()
    views = looks(3, 200)
    back = seen(views[(views @ rotation) @ POLE < 0.0][:40], rotation, 1)
    for percept in back[:20]:
        state, belief = machine.update(state, percept)
    for percept in [*seen(patch @ rotation.T, rotation, paint), *back[20:]]:
        state, belief = machine.update(state, percept)
        if belief.conclusion is not None and belief.conclusion.outcome is not Outcome.IDENTIFIED:
            break
    return belief


def test_what_is_like_a_candidate_but_for_one_side_is_not_named_and_that_is_said() -> None:
    belief = looked_around(held(3), CAP, 60, FilterOptions(slips=0))
    assert belief.leader == -1
    assert belief.conclusion is not None
    assert belief.conclusion.outcome is Outcome.UNDECIDED
    assert "it looks like a, but from one side like nothing that was learned" in belief.conclusion.reason
    assert belief.estimate.unknown is not None
    assert belief.estimate.unknown > 0.2


def test_where_that_passes_for_a_slip_it_is_not_named_either() -> None:
    belief = looked_around(held(3), CAP, 60, FilterOptions(slips=3))
    assert belief.conclusion is not None
    assert belief.conclusion.outcome is Outcome.UNKNOWN


@pytest.mark.parametrize("turned_deg", [0.0, 90.0])
def test_what_spoke_against_a_pose_that_was_lost_counts_where_it_is_found_again(turned_deg: float) -> None:
    machine, rotation = interpreter(A, B), held(3)
    state = machine.start()
    *before, last = seen(looks(3, 21), rotation, 1)
    for percept in before:
        state, belief = machine.update(state, percept)
    assert belief.leader == 0
    turned = axis_rotation(POLE, np.radians(turned_deg))
    state, belief = machine.update(replace(state, lost=Lost(0, rotation @ turned, 8.0)), last)
    assert (belief.leader == 0) == (turned_deg > 0.0)


def test_what_a_single_place_shows_is_no_other_side() -> None:
    at_one_place = unit(POLE + 0.03 * np.eye(3))
    belief = looked_around(held(3), at_one_place, 60, FilterOptions(slips=0))
    assert belief.conclusion is None or belief.conclusion.outcome is Outcome.IDENTIFIED


def test_where_nothing_unknown_is_expected_the_model_is_wrong_there() -> None:
    belief = looked_around(held(3), CAP, 60, FilterOptions(slips=0, unknown_prior=0.0))
    assert belief.leader == 0


def test_all_of_the_object_itself_is_no_other_side() -> None:
    belief = looked_around(held(3), CAP, 1, FilterOptions())
    assert belief.leader == 0
    assert belief.estimate.unknown == pytest.approx(0.0, abs=1e-3)
