"""The pose filter: who it is and how it is held, from looks at painted objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from painted import POLE, TWIN, held, interpreter, looks, model, ring, ring_model, seen, unit

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between, rotation_angle
from viewsep.interfaces import Interpretation
from viewsep.interpretation.filter_state import FilterOptions, FilterState
from viewsep.interpretation.independence import independent_share
from viewsep.interpretation.judgement import foreseen
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.interpretation.posterior import RotationGrid
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.kinematics import preset
from viewsep.messages import Outcome
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


def test_a_model_of_a_ring_foretells_nothing_away_from_it() -> None:
    """What it does not foretell cannot have misled it, however often one looks there."""
    machine = interpreter(ring_model("a", 1), ring_model("b", 2), model("c", 3))
    around = ring(10.0)
    state = machine.start()
    for percept in seen(around, np.eye(3), 1):
        state, _ = machine.update(state, percept)
    assert (
        foreseen(machine.predictions, machine.options, state, 0).mean() > 0.75
    )  # the grid's best rotation is some degrees off
    assert foreseen(machine.predictions, machine.options, state, 2).all()
    grid = rotation_grid(machine.options.rotations)
    upright = int(np.argmax(np.abs(grid @ POLE @ around.T).min(axis=1) - np.abs(grid[:, 2, 2])))
    log_p = state.posterior.log_p.copy()
    log_p[1, upright] = log_p[1].max() + 1.0  # as if b were likeliest with its ring across the looks
    across = replace(state, posterior=replace(state.posterior, log_p=log_p))
    assert 0 < foreseen(machine.predictions, machine.options, across, 1).sum() < len(around) / 2


@pytest.mark.parametrize("upright_within_deg", [15.0, 180.0])
def test_of_objects_that_stand_a_ring_tells_that_it_is_nobody(upright_within_deg: float) -> None:
    """Otherwise a candidate may be held so that sides are seen of which it has no views."""
    options = FilterOptions(upright_within_deg=upright_within_deg)
    machine = interpreter(ring_model("a", 1, 40.0), ring_model("b", 2, 40.0), options=options)
    state = machine.start()
    for percept in seen(ring(10.0, 40.0), np.eye(3), 60):
        state, belief = machine.update(state, percept)
    concluded = belief.conclusion is not None and belief.conclusion.outcome is Outcome.UNKNOWN
    assert concluded is (upright_within_deg < 180.0)


def test_objects_that_lean_are_improbable_but_not_impossible() -> None:
    grid = RotationGrid(4000)
    log_prior = grid.log_prior(np.radians(20.0), 25.0)
    leaning = np.degrees(np.arccos(grid.rotations[:, 2, 2]))
    assert np.exp(log_prior).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(log_prior.max() - log_prior, np.where(leaning > 20.0, 25.0, 0.0))
    np.testing.assert_allclose(grid.log_prior(np.pi, 25.0), -np.log(4000))


# ---- probabilities mean what they say ----


def test_probabilities_are_as_high_as_the_share_that_is_right() -> None:
    """Of two twins that differ by little in comparison to the noise of the looks, all around the pole.

    Of N independent tasks as many are right as the probabilities sum to, give or take the standard deviation
    sqrt(sum of P (1 - P)): three of them are allowed. With evidence that counts
    three times as much, or a third, it is off by four or more.
    """
    noise, difference, tasks = 0.3, 1.0, 100
    names = (("a", 0.0), ("b", difference))
    machine = interpreter(
        *(model(name, 1, twin, noise=noise, disturbed=noise) for name, twin in names),
        options=FilterOptions(rotations=4000),
    )
    probability, right = np.empty((tasks, 4)), np.empty((tasks, 4), bool)
    for task in range(tasks):
        truth = task % 2
        views = unit(np.random.default_rng(task).normal(size=(100, 3)))
        views = views[views[:, 2] > 0.5][:4] @ held(task).T
        state = machine.start()
        for n, percept in enumerate(seen(views, held(task), 1, names[truth][1], noise=noise, seed=task)):
            state, _ = machine.update(state, percept)
            found = state.posterior.probabilities()
            probability[task, n], right[task, n] = found.max(), found.argmax() == truth
    deviation = np.sqrt((probability * (1.0 - probability)).sum(axis=0)) / tasks
    assert (np.abs(right.mean(axis=0) - probability.mean(axis=0)) < 3.0 * deviation).all()
    assert 0.6 < probability.mean() < 0.95  # it was neither easy nor hopeless
    sure = probability > 0.9
    assert sure.sum() > 50
    assert right[sure].mean() > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_twins_that_were_seen_from_the_same_side_only_are_never_named(seed: int) -> None:
    machine = interpreter(model("a", 1, noise=0.1, disturbed=0.1), model("b", 1, TWIN, noise=0.1, disturbed=0.1))
    state, views = machine.start(), looks(seed, 200)
    hidden = views[(views @ held(seed))[:, 2] < 0.2][:25]
    for percept in seen(hidden, held(seed), 1, TWIN * (seed % 2), noise=0.05, seed=seed):
        state, belief = machine.update(state, percept)
        assert belief.leader == -1
        assert belief.conclusion is None
    assert state.posterior.probabilities() == pytest.approx(0.5, abs=0.1)  # there is nothing to tell them apart by
    assert belief.plausible.all()
    assert np.degrees(rotation_angle(belief.rotations[seed % 2], held(seed))) < 10.0


@pytest.mark.parametrize("seed", range(3))
def test_an_unknown_object_is_concluded_with_a_reason(seed: int) -> None:
    machine = interpreter(*(model(f"m{k}", 20 + k, noise=0.05, disturbed=0.05) for k in range(8)))
    state = machine.start()
    for percept in seen(looks(seed, 10), held(seed), 60 + seed, noise=0.05, seed=seed):
        state, belief = machine.update(state, percept)
    assert belief.conclusion is not None
    assert belief.conclusion.outcome is Outcome.UNKNOWN
    assert belief.conclusion.reason == "the probability of that is 1.0000 after 10 looks"
    assert belief.leader == -1
    assert belief.estimate.unknown == pytest.approx(1.0, abs=1e-3)
    assert not belief.converged


def test_looks_at_one_region_alone_tell_nothing_about_it_being_nobody() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    middle, aside, _ = np.eye(3)
    near = [unit(middle + np.tan(np.radians(angle)) * aside) for angle in np.linspace(-20.0, 20.0, 9)]
    state = machine.start()
    for percept in seen(np.array(near), held(4), 60):
        state, belief = machine.update(state, percept)
        assert belief.conclusion is None
        assert belief.estimate.unknown == pytest.approx(FilterOptions().unknown_prior)
        assert not belief.converged
    for percept in seen(np.array([-middle, aside]), held(4), 60):
        state, belief = machine.update(state, percept)
    assert belief.estimate.unknown is not None
    assert belief.estimate.unknown > 0.999
    assert belief.conclusion is not None
    assert belief.conclusion.outcome is Outcome.UNKNOWN


def test_an_identification_says_how_sure_it_is_and_the_estimate_lists_the_candidates() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    state = machine.start()
    for percept in seen(looks(1, 8), held(1), 2):
        state, belief = machine.update(state, percept)
    assert belief.conclusion is not None
    assert belief.conclusion.outcome is Outcome.IDENTIFIED
    assert belief.conclusion.reason == "its probability is 1.0000 after 8 looks"
    wrong, right = belief.estimate.candidates
    assert (wrong.name, right.name) == ("a", "b")
    assert right.probability == pytest.approx(1.0, abs=1e-4)
    assert right.rating == pytest.approx(1.0, abs=1e-4)
    assert wrong.rating > 100.0
    assert right.w0 > wrong.w0
    assert right.w1 == pytest.approx(np.sqrt(right.variance))
    assert belief.estimate.iteration == 8
    assert belief.estimate.note == ""


def test_samples_stand_for_the_posterior() -> None:
    machine = interpreter(model("a", 1), model("b", 1, TWIN))
    state, views = machine.start(), looks(3, 200)
    for percept in seen(views[(views @ held(3))[:, 2] < 0.2][:8], held(3), 1):
        state, belief = machine.update(state, percept)
    samples, found = belief.samples, state.posterior.probabilities()
    assert samples.weight[samples.owner == 0].sum() == pytest.approx(found[0])
    assert samples.weight[samples.owner == 1].sum() == pytest.approx(found[1])
    near = np.degrees(rotation_angle(samples.rotation, held(3)))
    assert np.average(near, weights=samples.weight) < 15.0
    np.testing.assert_array_equal(samples.seen, state.views)
    assert samples.independent_rad == pytest.approx(np.radians(10.0))


# ---- looks from where it has looked before ----


def test_a_look_from_where_it_was_looked_from_before_adds_a_tenth() -> None:
    machine = interpreter(model("a", 1), model("b", 2), options=FilterOptions(motion_noise_deg=0.0, floor=200.0))
    first, *_, last = views = looks(1, 4, step_deg=30.0)
    percepts = seen(np.array([*views, first]), held(1), 1)
    state = machine.start()
    for percept in percepts[:-1]:
        state, _ = machine.update(state, percept)
    again, _ = machine.update(state, percepts[-1])
    assert state.shares == pytest.approx(np.ones(4), abs=0.01)
    (repeated,) = independent_share(first[None], state.views, np.radians(10.0))
    assert repeated == pytest.approx(0.1, abs=0.002)
    assert again.shares == pytest.approx([*state.shares, repeated])
    look = machine.predictions.project(percepts[-1].feature)
    likelihood = machine.predictions.log_likelihood(look, state.posterior.active, state.calm)
    cells = machine.grid.cells(first)
    gained = again.posterior.log_p + again.posterior.evidence - state.posterior.log_p - state.posterior.evidence
    kept = state.posterior.log_p > state.posterior.log_p.max() - 100.0
    np.testing.assert_allclose(gained[kept], repeated * likelihood[:, cells][kept], atol=1e-3)
    assert angle_between(first, last) > np.radians(10.0)


def test_a_look_after_half_the_angle_counts_half() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    state = machine.start()
    for percept in seen(looks(1, 4, step_deg=5.0), held(1), 1):
        state, _ = machine.update(state, percept)
    assert state.shares == pytest.approx([1.0, 0.5, 0.5, 0.5], abs=0.01)


# ---- slips ----


def lost_between(poses: list[int], machine: FilterInterpreter) -> tuple[FilterState, list[Interpretation]]:
    """Object 1 held in one pose after the other, for 12 looks each, and three looks at a hand in between."""
    state = machine.start()
    beliefs: list[Interpretation] = []
    views = looks(2, 15 * len(poses), step_deg=15.0)
    for part, pose in zip(np.split(views, len(poses)), poses, strict=True):
        hand = seen(part[:3], held(pose), 9) if beliefs else []
        for percept in [*hand, *seen(part[3:], held(pose), 1)]:
            state, belief = machine.update(state, percept)
            beliefs.append(belief)
    return state, beliefs


def test_when_looks_stop_to_fit_the_pose_is_searched_anew_and_that_is_said() -> None:
    state, beliefs = lost_between([2, 11], interpreter(model("a", 1), model("b", 2)))
    (when,) = [n for n, belief in enumerate(beliefs) if belief.estimate.note]
    assert 12 <= when < 15  # while the hand was there
    assert [belief.fresh for belief in beliefs] == [n == when for n in range(len(beliefs))]
    assert "slipped" in beliefs[when].estimate.note
    assert "its pose is searched anew" in beliefs[when].estimate.note
    assert state.slips == 1
    assert state.count == len(beliefs)
    assert len(state.views) == len(state.looks) == len(state.shares) == state.count - when  # older looks do not count
    assert state.posterior.probabilities()[0] > 0.99
    assert np.degrees(rotation_angle(beliefs[-1].rotations[0], held(11))) < 10.0
    before, after = (
        [belief.conclusion.reason for belief in part if belief.conclusion] for part in (beliefs[:when], beliefs[when:])
    )
    assert after
    assert all(reason.endswith("looks, its pose lost once") for reason in after)
    assert not any("lost" in reason for reason in before)


@pytest.mark.parametrize("limit", [0, 1, 2])
def test_a_pose_may_be_lost_so_often_and_no_more(limit: int) -> None:
    machine = interpreter(model("a", 1), model("b", 2), options=FilterOptions(slips=limit))
    state, beliefs = lost_between([2, 11, 20, 33], machine)
    notes = [belief.estimate.note for belief in beliefs if belief.estimate.note]
    assert sum("searched anew" in note for note in notes) == state.slips == limit
    assert len(notes) == 3  # otherwise it is noticed when the new pose is known
    reasons = [belief.conclusion.reason for belief in beliefs if belief.conclusion]
    assert any("2 of its poses lost on the way" in reason for reason in reasons) == (limit == 2)
    assert any("lost" in reason for reason in reasons) == (limit > 0)


def test_an_object_that_never_fitted_has_not_slipped() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    state = machine.start()
    for percept in seen(looks(5, 12), held(5), 9):
        state, belief = machine.update(state, percept)
        assert belief.estimate.note == ""
    assert state.slips == 0
