"""The pose filter: who it is and how it is held, from looks at painted objects."""

from __future__ import annotations

import numpy as np
import pytest
from painted import TWIN, held, interpreter, looks, model, seen, unit

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.geometry import rotation_angle
from viewsep.kinematics import preset
from viewsep.planning.random_motion import RandomPlanner
from viewsep.planning.reachable import ReachableViews


@pytest.mark.parametrize("seed", range(6))
def test_pose_and_identity_are_found(seed: int) -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    rotation = held(seed)
    state = machine.start()
    for percept in seen(looks(seed, 25), rotation, 1 + seed % 2):
        state, belief = machine.update(state, percept)
    assert belief.leader == seed % 2
    assert np.degrees(rotation_angle(belief.rotations[seed % 2], rotation)) < 8.0
    assert belief.converged
    total = state.posterior.probabilities().sum() + np.exp(state.posterior.none)
    assert total == pytest.approx(1.0, abs=1e-4)


def test_twins_are_told_apart_only_where_they_differ() -> None:
    machine = interpreter(model("a", 1), model("b", 1, twin=TWIN))
    rotation = held(3)
    state = machine.start()
    views = looks(3, 200)
    hidden = views[(views @ rotation)[:, 2] < 0.3][:30]
    for percept in seen(hidden, rotation, 1):
        state, belief = machine.update(state, percept)
    assert belief.leader == -1
    poles = unit(np.array([[0.1, 0.1, 1.0], [-0.3, 0.1, 1.0], [0.3, -0.2, 1.0], [0.0, -0.4, 1.0]]))
    for percept in seen(poles @ rotation.T, rotation, 1):
        state, belief = machine.update(state, percept)
    assert belief.leader == 0


def test_an_object_that_is_no_candidate_is_none_of_them() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    state = machine.start()
    for percept in seen(looks(5, 20), held(5), 9):
        state, belief = machine.update(state, percept)
    assert np.exp(state.posterior.none) > 0.99
    assert belief.leader == -1


def test_a_look_from_the_same_place_is_no_further_evidence() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    percept, *_ = seen(looks(1, 1), held(1), 1)
    first, _ = machine.update(machine.start(), percept)
    second, _ = machine.update(first, percept)
    np.testing.assert_array_equal(first.posterior.log_p, second.posterior.log_p)


def test_a_slip_is_recovered_from() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    before, after = held(2), held(11)
    assert np.degrees(rotation_angle(before, after)) > 60.0
    state = machine.start()
    views = looks(2, 60)
    for percept in [*seen(views[:30], before, 1), *seen(views[30:], after, 1)]:
        state, belief = machine.update(state, percept)
    assert belief.leader == 0
    assert np.degrees(rotation_angle(belief.rotations[0], after)) < 10.0


def test_the_state_can_be_saved_and_gives_the_same_bits() -> None:
    models = [model("a", 1), model("b", 2)]
    machine = interpreter(*models)
    engine = Engine(machine, RandomPlanner(models, ReachableViews.of(preset("gimbal"))))
    percepts = seen(looks(4, 12), held(4), 2)
    state = machine.start()
    for percept in percepts[:6]:
        state, belief = machine.update(state, percept)
    kept = engine.restore(engine.save(EngineState(interpretation=state, belief=belief))).interpretation
    for percept in percepts[6:]:
        state, belief = machine.update(state, percept)
        kept, again = machine.update(kept, percept)
    assert engine.save(EngineState(interpretation=state, belief=belief)) == engine.save(
        EngineState(interpretation=kept, belief=again)
    )
