"""More candidates than can be followed at once: some are parked, and taken up again when they rate better."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from painted import POLE, held, interpreter, looks, model, seen, unit

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.geometry import rotation_angle
from viewsep.interfaces import Interpretation
from viewsep.interpretation.filter_state import FilterOptions, FilterState
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.kinematics import preset
from viewsep.messages import FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.random_motion import RandomPlanner
from viewsep.planning.reachable import ReachableViews

COUNT, FOLLOWED, ROTATIONS = 60, 8, 4000


@cache
def library() -> tuple[AspectGraph, ...]:
    return tuple(model(f"m{k}", k) for k in range(COUNT))


@cache
def look_alikes() -> tuple[AspectGraph, ...]:
    """Six objects of ten variants each, that differ around one pole by less and more."""
    return tuple(model(f"m{k}", 70 + k // 10, strength(k)) for k in range(COUNT))


def strength(k: int) -> float:
    return float([0.0, *np.geomspace(0.5, 40.0, 9)][k % 10])


@cache
def following(count: int, alike: bool = False, floor: float = 25.0) -> FilterInterpreter:
    options = FilterOptions(rotations=ROTATIONS, followed=count, motion_noise_deg=0.0, floor=floor)
    return interpreter(*(look_alikes() if alike else library()), options=options)


def told(machine: FilterInterpreter, percepts: list[Percept]) -> tuple[FilterState, Interpretation]:
    state = machine.start()
    for percept in percepts:
        state, belief = machine.update(state, percept)
        assert len(state.posterior.active) <= machine.options.followed
        assert state.posterior.log_p.shape == (len(state.posterior.active), ROTATIONS)
        total = state.posterior.probabilities().sum() + np.exp(state.posterior.none)
        assert total == pytest.approx(1.0, abs=1e-4)
    return state, belief


def first_wrong(seed: int, truth: int) -> list[Percept]:
    """Looks at the true object, but for the first one, which is at another."""
    views = looks(seed, 16)
    (wrong,) = seen(views[:1], held(seed), (truth + 13) % COUNT)
    return [wrong, *seen(views, held(seed), truth)[1:]]


@pytest.mark.parametrize("seed", range(4))
def test_the_one_of_many_is_found_and_its_pose(seed: int) -> None:
    truth = (17 * seed + 20) % COUNT
    state, belief = told(following(FOLLOWED), seen(looks(seed, 10), held(seed), truth, noise=0.1, seed=seed))
    assert belief.leader == truth
    assert np.degrees(rotation_angle(belief.rotations[truth], held(seed))) < 12.0
    assert truth in state.posterior.active


def around_the_pole(seed: int, count: int, *, sees: bool) -> FloatArray:
    """Views in the object's frame, of the pole or not."""
    views = unit(np.random.default_rng(seed).normal(size=(300, 3)))
    chosen: FloatArray = views[views @ POLE > 0.5 if sees else views @ POLE < 0.3][:count]
    return chosen


@pytest.mark.parametrize("seed", [1, 4, 8, 10])
def test_of_many_look_alikes_the_same_is_named_as_when_all_are_followed(seed: int) -> None:
    truth = (17 * seed + 20) % COUNT
    views = np.concatenate([around_the_pole(seed, 4, sees=False), around_the_pole(seed, 8, sees=True)]) @ held(seed).T
    percepts = seen(views, held(seed), 70 + truth // 10, strength(truth), noise=0.05, seed=seed)
    state, few = told(following(FOLLOWED, alike=True), percepts)
    _, every = told(following(COUNT, alike=True), percepts)
    assert few.leader == every.leader == truth
    np.testing.assert_allclose(few.rotations[truth], every.rotations[truth], atol=0.02)
    assert state.posterior.log_p.nbytes <= FOLLOWED * ROTATIONS * 4


def test_only_so_many_are_followed_and_the_rest_is_parked() -> None:
    state = following(FOLLOWED).start()
    assert len(state.posterior.active) == FOLLOWED
    assert np.isneginf(state.posterior.parked).sum() == FOLLOWED
    np.testing.assert_allclose(state.posterior.probabilities(), 0.95 / COUNT, rtol=1e-4)
    assert len(following(COUNT).start().posterior.active) == COUNT


def test_with_the_first_look_those_are_followed_that_it_fits_best() -> None:
    truth = 55  # not among the first ones
    state, _ = told(following(FOLLOWED), seen(looks(3, 1), held(3), truth))
    assert truth in state.posterior.active


def test_what_is_no_longer_followed_keeps_its_probability() -> None:
    machine, percepts = following(FOLLOWED, alike=True), seen(looks(2, 3), held(2), 70)
    state, _ = told(machine, percepts)
    dropped = replace(state, posterior=replace(state.posterior, log_p=state.posterior.log_p.copy()))
    worst = int(np.argmin(dropped.posterior.log_mass))
    dropped.posterior.log_p[worst] -= 60.0  # too unlikely to be followed on
    after, _ = machine.update(dropped, seen(looks(2, 4), held(2), 70)[-1])
    left = int(dropped.posterior.active[worst])
    assert left not in after.posterior.active
    assert np.isfinite(after.posterior.parked[left])
    assert after.posterior.probabilities()[left] < 1e-6


@pytest.mark.parametrize("seed", [1, 3, 5, 7])
def test_a_parked_candidate_is_taken_up_again(seed: int) -> None:
    truth = (7 * seed + 3) % COUNT
    machine, percepts = following(FOLLOWED), first_wrong(seed, truth)
    state, _ = told(machine, percepts[:1])
    assert truth not in state.posterior.active
    state, belief = told(machine, percepts)
    assert truth in state.posterior.active
    assert belief.leader == truth


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_taken_up_again_its_rotations_are_as_if_it_had_been_followed_from_the_start(seed: int) -> None:
    """As far as none of them has fallen to the floor, below which only those that are followed do not fall."""
    truth = (7 * seed + 3) % COUNT
    percepts = first_wrong(seed, truth)
    few, every = following(FOLLOWED, floor=200.0), following(COUNT, floor=200.0)
    state, whole = few.start(), every.start()
    before, compared = set(range(COUNT)), 0
    for percept in percepts[:4]:
        state, _ = few.update(state, percept)
        whole, _ = every.update(whole, percept)
        active = state.posterior.active.tolist()
        for k in set(active) - before:
            replayed = state.posterior.log_p[active.index(k)] + state.posterior.evidence
            followed = whole.posterior.log_p[k] + whole.posterior.evidence
            off_floor = whole.posterior.log_p[k] > max(whole.posterior.log_p.max(), whole.posterior.none) - 100.0
            np.testing.assert_allclose(replayed[off_floor], followed[off_floor], atol=1e-3)
            compared += int(off_floor.sum())
        before = set(active)
    assert compared > 10


def test_an_unknown_object_is_none_of_many() -> None:
    state, belief = told(following(FOLLOWED), seen(looks(5, 12), held(5), 99))
    assert np.exp(state.posterior.none) > 0.99
    assert belief.leader == -1


def test_the_state_of_a_large_library_can_be_saved_and_gives_the_same_bits() -> None:
    """With parked candidates, one of which is taken up after it was saved."""
    machine = following(FOLLOWED)
    engine = Engine(machine, RandomPlanner(library(), ReachableViews.of(preset("gimbal"))))
    percepts = first_wrong(7, 52)
    state, belief = told(machine, percepts[:1])
    assert 52 not in state.posterior.active
    kept = engine.restore(engine.save(EngineState(interpretation=state, belief=belief))).interpretation
    for percept in percepts[1:]:
        state, belief = machine.update(state, percept)
        kept, again = machine.update(kept, percept)
    assert 52 in state.posterior.active
    assert engine.save(EngineState(interpretation=state, belief=belief)) == engine.save(
        EngineState(interpretation=kept, belief=again)
    )


def test_the_hypotheses_that_are_shown_are_those_of_followed_candidates() -> None:
    machine = following(FOLLOWED)
    state, _ = told(machine, seen(looks(3, 2), held(3), 55))
    shown = machine.hypotheses(state, 7)
    assert shown.candidates == tuple(f"m{k}" for k in range(COUNT))
    assert set(shown.owner.tolist()) == set(state.posterior.active.tolist())
    assert shown.weight.sum() == pytest.approx(1.0)
