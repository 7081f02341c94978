"""The planner by information: to where twins differ, over reachable views only, and to an end when nothing helps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from painted import EDGES, NODES, POLE, TWIN, graph, held, interpreter, model, noisy, painted, seen

from viewsep.geometry import angle_between, axis_rotation, equidistant_sphere, rotation_showing, spherical_direction
from viewsep.interfaces import Conclusion, Interpretation, NextView, PoseSamples
from viewsep.kinematics import preset
from viewsep.messages import CandidateEstimate, Estimate, FloatArray, Outcome, Phase
from viewsep.models.aspect_graph import AspectGraph, Trials
from viewsep.planning import information
from viewsep.planning.information import InformationOptions, InformationPlanner, InformationState
from viewsep.planning.reachable import ReachableViews
from viewsep.trials import trial_directions

RIGS = ("gimbal", "turntable", "single views")
EVERY_RIG = pytest.mark.parametrize("rig", RIGS)
NAMED = Conclusion(Outcome.IDENTIFIED, "its probability is high")
Part = tuple[int, FloatArray, float]
"""A candidate, a rotation it may be held in, and how likely that is."""


@pytest.fixture(autouse=True, scope="module")
def sphere_once() -> Iterator[None]:
    """Every planner makes the same sphere of views, which takes most of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(information, "equidistant_sphere", cache(equidistant_sphere), raising=False)
        yield


@cache
def views_of(rig: str) -> ReachableViews:
    if rig != "single views":
        return ReachableViews.of(preset(rig))
    rings = [
        spherical_direction(np.radians(15.0 * a), np.radians(elevation))
        for elevation in (-30.0, 0.0, 30.0, 60.0)
        for a in range(24)
    ]
    return ReachableViews.only(np.array(rings))


@cache
def pair(difference: float) -> tuple[AspectGraph, AspectGraph]:
    return model("a", 1, noise=0.1, disturbed=0.1), model("b", 1, difference, noise=0.1, disturbed=0.1)


@cache
def planner_on(
    rig: str, difference: float = TWIN, options: InformationOptions | None = None, models: tuple[AspectGraph, ...] = ()
) -> InformationPlanner:
    return InformationPlanner(models or pair(difference), views_of(rig), options)


def belief(
    parts: Sequence[Part],
    *,
    converged: bool = True,
    conclusion: Conclusion | None = None,
    looked: Sequence[FloatArray] = (),
    candidates: int = 2,
) -> Interpretation:
    """What an interpreter believes that knows of these parts, and looked from there."""
    owner, rotation, weight = (np.array(column) for column in zip(*parts, strict=True))
    probability = np.bincount(owner, weight, candidates)
    estimate = Estimate(
        0,
        1,
        Phase.EXPLORING,
        tuple(
            CandidateEstimate(f"c{k}", 1.0, 1.0, 0.1, 0.0, np.eye(3), 0.01, True, 1, probability=float(likely))
            for k, likely in enumerate(probability)
        ),
        0,
        0.0,
        None,
    )
    samples = PoseSamples(owner, rotation, weight, np.array(looked).reshape(-1, 3), float(np.radians(10.0)))
    leader = 0 if conclusion else -1
    return Interpretation(
        estimate, np.array([np.eye(3)] * candidates), converged, probability > 0.01, leader, False, conclusion, samples
    )


def both(rotation: FloatArray) -> list[Part]:
    """One of two, equally likely, both held in the same way."""
    return [(0, rotation, 0.5), (1, rotation, 0.5)]


def pole_at(view: FloatArray) -> FloatArray:
    """A rotation in which the pole where twins differ is seen from a view."""
    return rotation_showing(POLE, view, 0.3)


def drive(
    planner: InformationPlanner, view: FloatArray, parts: Sequence[Part], plans: int, seed: int = 1, **known: Any
) -> tuple[list[FloatArray], list[NextView]]:
    """Views and plans of a rig that goes wherever it is sent, while the belief stays but for where it has looked."""
    state, _ = planner.start(seed, view)
    views, wanted = [view], []
    for _ in range(plans):
        state, plan = planner.next_view(state, views[-1], belief(parts, looked=views, **known))
        wanted.append(plan)
        if plan.view_direction is None:
            break
        views.append(plan.view_direction)
    return views, wanted


def start_view(rig: str) -> FloatArray:
    start: FloatArray = views_of(rig).directions[7]
    return start


# ---- where it goes ----


@EVERY_RIG
def test_a_task_starts_where_the_rig_is(rig: str) -> None:
    state, wanted = planner_on(rig).start(1, start_view(rig))
    assert wanted.view_direction is None
    assert wanted.purpose is Phase.STARTING
    assert state.idle == 0


@EVERY_RIG
@pytest.mark.parametrize("empty", [False, True], ids=["no belief", "no samples"])
def test_as_long_as_nothing_is_known_it_explores(rig: str, empty: bool) -> None:
    planner = planner_on(rig)
    nothing = Interpretation(
        Estimate(0, 1, Phase.EXPLORING, (), 0, 0.0, None), np.eye(3)[None], False, np.ones(1, bool), -1, True
    )
    view = start_view(rig)
    state, _ = planner.start(1, view)
    views = [view]
    for _ in range(8):
        state, wanted = planner.next_view(state, views[-1], nothing if empty else None)
        assert wanted.purpose is Phase.EXPLORING
        assert wanted.target is None
        assert wanted.conclusion is None
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        views.append(wanted.view_direction)
    assert np.degrees(angle_between(np.array(views[:-1]), np.array(views[1:]))).min() > 4.0


@EVERY_RIG
@pytest.mark.parametrize("seed", [1, 2])
def test_all_views_it_asks_for_can_be_reached_and_are_the_same_every_time(rig: str, seed: int) -> None:
    planner, parts = planner_on(rig), [(0, held(seed), 0.4), (0, held(seed + 20), 0.2), (1, held(seed), 0.4)]
    views, wanted = drive(planner, start_view(rig), parts, 8, seed)
    assert planner.reachable.reaches(np.array(views)).all()
    for plan in wanted:
        assert plan.target is None or planner.reachable.reaches(plan.target)
        assert (plan.target is None) == (plan.purpose is Phase.EXPLORING)
    again, _ = drive(planner, start_view(rig), parts, 8, seed)
    np.testing.assert_array_equal(again, views)


@EVERY_RIG
@pytest.mark.parametrize("place", [40, 75])
def test_it_drives_to_the_pole_that_tells_twins_apart(rig: str, place: int) -> None:
    """Half a turn away at most, in movements of up to 60 degrees."""
    reachable = views_of(rig)
    pole = reachable.directions[place * len(reachable.directions) // 96]
    _, wanted = drive(planner_on(rig), start_view(rig), both(pole_at(pole)), 4)
    near = [float(angle_between(plan.view_direction, pole)) for plan in wanted if plan.view_direction is not None]
    assert np.degrees(min(near)) < 60.0
    assert all(plan.purpose is Phase.APPROACHING and plan.arrives for plan in wanted)
    assert all(plan.target is not None and plan.target @ pole > 0.2 for plan in wanted)


def test_a_movement_is_neither_too_short_nor_too_long() -> None:
    options = InformationOptions(step_deg=20.0, longest_deg=30.0)
    start = np.array([0.0, -1.0, 0.0])
    views, _ = drive(planner_on("gimbal", options=options), start, both(pole_at(-start)), 6)
    steps = np.degrees(angle_between(np.array(views[:-1]), np.array(views[1:])))
    assert steps[0] == pytest.approx(30.0, abs=10.0)  # to one of the views 10 degrees apart
    assert steps.max() <= 40.0 + 1e-6
    assert steps.min() >= 10.0  # a target may be half a step away


def test_of_two_places_that_tell_it_takes_the_nearer_one() -> None:
    """Held in either of two ways, the pole is on this side or on the other."""
    start, aside = np.array([0.0, -1.0, 0.0]), axis_rotation(np.array([0.0, 0.0, 1.0]), np.radians(80.0))
    near, far = aside @ start, aside @ aside @ start
    parts = [(owner, pole_at(pole), 0.25) for pole in (near, far) for owner in (0, 1)]
    _, wanted = drive(planner_on("gimbal"), start, parts, 1)
    assert wanted[0].view_direction is not None
    assert angle_between(wanted[0].view_direction, near) < angle_between(start, near)
    assert wanted[0].view_direction @ near > wanted[0].view_direction @ far


@EVERY_RIG
def test_planning_does_not_change_the_state_it_was_given(rig: str) -> None:
    planner, view = planner_on(rig, difference=0.0), start_view(rig)
    state, _ = planner.start(3, view)
    plans = [planner.next_view(state, view, belief(both(held(3)))) for _ in range(2)]
    assert state.idle == 0
    assert [after.idle for after, _ in plans] == [1, 1]
    np.testing.assert_array_equal(plans[0][1].view_direction, plans[1][1].view_direction)


# ---- how it ends ----


def until_concluded(
    planner: InformationPlanner, view: FloatArray, parts: Sequence[Part], **known: Any
) -> tuple[int, Conclusion]:
    """After how many plans it concluded, and what."""
    _, wanted = drive(planner, view, parts, 60, **known)
    assert all(plan.conclusion is None for plan in wanted[:-1])
    assert wanted[-1].conclusion is not None
    return len(wanted), wanted[-1].conclusion


@EVERY_RIG
@pytest.mark.parametrize("patience", [1, 4])
def test_identical_twins_are_indistinguishable_once_it_has_been_patient(rig: str, patience: int) -> None:
    options = InformationOptions(patience=patience, lost_patience=50)
    planner = planner_on(rig, difference=0.0, options=options)
    plans, conclusion = until_concluded(planner, start_view(rig), both(held(3)))
    assert plans == patience
    assert conclusion.outcome is Outcome.INDISTINGUISHABLE
    assert conclusion.indistinct == (0, 1)
    assert conclusion.telling_view is None  # from nowhere
    assert conclusion.reason == "no view that this rig can show tells them apart"


def test_with_a_pose_that_is_not_known_it_is_patient_for_longer() -> None:
    planner = planner_on("gimbal", difference=0.0, options=InformationOptions(patience=2, lost_patience=7))
    plans, _ = until_concluded(planner, start_view("gimbal"), both(held(3)), converged=False)
    assert plans == 7


def test_a_view_that_promises_something_renews_its_patience() -> None:
    planner, view = planner_on("gimbal"), start_view("gimbal")
    state, _ = planner.start(1, view)
    state, wanted = planner.next_view(InformationState(state.exploration, idle=3), view, belief(both(held(3))))
    assert state.idle == 0
    assert wanted.conclusion is None


def test_a_turntable_says_which_view_it_would_need() -> None:
    """The pole where the twins differ points down."""
    below = pole_at(np.array([0.0, 0.0, -1.0]))
    reachable = views_of("turntable")
    assert (reachable.directions @ below @ POLE).max() < -0.4
    _, conclusion = until_concluded(planner_on("turntable"), start_view("turntable"), both(below))
    assert conclusion.outcome is Outcome.INDISTINGUISHABLE
    assert conclusion.indistinct == (0, 1)
    assert conclusion.telling_view is not None
    assert np.linalg.norm(conclusion.telling_view) == pytest.approx(1.0)
    assert not reachable.reaches(conclusion.telling_view)
    assert conclusion.telling_view @ below @ POLE > 0.7


def test_only_those_that_are_likely_cannot_be_told_apart() -> None:
    models = (*pair(0.0), model("c", 5, noise=0.1, disturbed=0.1))
    parts = [(0, held(3), 0.5), (1, held(3), 0.499), (2, held(3), 0.001)]
    options = InformationOptions(least_bits=0.1)
    planner = planner_on("gimbal", models=models, options=options)
    _, conclusion = until_concluded(planner, start_view("gimbal"), parts, candidates=3)
    assert conclusion.indistinct == (0, 1)


def test_where_it_may_be_an_unknown_object_nothing_is_concluded() -> None:
    parts = [(0, held(3), 0.3), (1, held(3), 0.3)]
    _, wanted = drive(planner_on("gimbal", difference=0.0), start_view("gimbal"), parts, 8)
    assert len(wanted) == 8
    assert all(plan.conclusion is None and plan.purpose is Phase.EXPLORING for plan in wanted)


def test_with_a_single_candidate_left_nothing_is_indistinguishable() -> None:
    _, wanted = drive(planner_on("gimbal"), start_view("gimbal"), [(0, held(3), 0.97), (1, held(3), 0.001)], 8)
    assert all(plan.conclusion is None for plan in wanted)


# ---- when only the pose is asked for ----


def test_when_the_name_is_known_it_goes_for_the_pose() -> None:
    """Two ways to hold it that look alike but around one place."""
    planner, view = planner_on("gimbal"), start_view("gimbal")
    parts = [(0, held(3), 0.49), (0, held(20), 0.49), (1, held(3), 0.02)]
    state, _ = planner.start(1, view)
    _, wanted = planner.next_view(state, view, belief(parts, conclusion=NAMED))
    assert wanted.purpose is Phase.APPROACHING
    assert wanted.conclusion is None
    assert wanted.view_direction is not None
    assert planner.reachable.reaches(wanted.view_direction)


def ball(name: str, paint: int) -> AspectGraph:
    """An object that looks the same from everywhere."""
    shown, tried = painted(NODES[:1], paint), trial_directions(40)
    looks_at_it = noisy(np.repeat(shown, len(tried), axis=0), 0.1, paint)
    trials = Trials(tried, looks_at_it, np.arange(len(tried)) % 4 < 2)
    return graph(name, NODES, EDGES, np.repeat(shown, len(NODES), axis=0), trials)


def test_what_no_view_tells_of_the_pose_ends_it_with_the_name() -> None:
    models = (ball("a", 1), model("b", 2, noise=0.1, disturbed=0.1))
    parts = [(0, held(3), 0.5), (0, held(20), 0.3), (0, held(40), 0.199), (1, held(3), 0.001)]
    planner = planner_on("gimbal", models=models, options=InformationOptions(patience=3))
    plans, conclusion = until_concluded(planner, start_view("gimbal"), parts, conclusion=NAMED)
    assert plans == 3
    assert conclusion.outcome is Outcome.IDENTIFIED
    assert conclusion.reason == "no view that this rig can show promises more about its pose"
    assert conclusion.indistinct == ()
    assert conclusion.telling_view is None


def test_when_the_name_is_known_it_is_of_no_use_what_tells_the_candidates_apart() -> None:
    planner = planner_on("gimbal", options=InformationOptions(patience=2))
    plans, conclusion = until_concluded(planner, start_view("gimbal"), both(held(3)), conclusion=NAMED)
    assert plans == 2
    assert conclusion.outcome is Outcome.IDENTIFIED


# ---- together with the pose filter ----


@EVERY_RIG
def test_with_the_filter_twins_are_told_apart_within_a_few_looks(rig: str) -> None:
    difference = 1.0
    machine, planner = interpreter(*pair(difference)), planner_on(rig, difference)
    for seed in (1, 4):
        view = views_of(rig).directions[7 * seed]
        rotation = held(seed)
        assert (views_of(rig).directions @ rotation @ POLE).max() > 0.6  # the rig can show where they differ
        state, (planning, _) = machine.start(), planner.start(seed, view)
        for look in range(12):
            (percept,) = seen(view[None], rotation, 1, difference * (seed % 2), noise=0.1, seed=100 * seed + look)
            state, known = machine.update(state, percept)
            if known.conclusion is not None:
                break
            planning, wanted = planner.next_view(planning, view, known)
            assert wanted.view_direction is not None
            assert planner.reachable.reaches(wanted.view_direction)
            view = wanted.view_direction
        assert known.conclusion is not None
        assert known.leader == seed % 2


@EVERY_RIG
def test_with_the_filter_identical_twins_are_found_indistinguishable(rig: str) -> None:
    machine, planner = interpreter(*pair(0.0)), planner_on(rig, difference=0.0)
    view, rotation = start_view(rig), held(2)
    state, (planning, _) = machine.start(), planner.start(2, view)
    conclusion = None
    for look in range(20):
        (percept,) = seen(view[None], rotation, 1, noise=0.1, seed=look)
        state, known = machine.update(state, percept)
        assert known.conclusion is None
        planning, wanted = planner.next_view(planning, view, known)
        conclusion = wanted.conclusion
        if conclusion is not None:
            break
        assert wanted.view_direction is not None
        view = wanted.view_direction
    assert conclusion is not None
    assert conclusion.outcome is Outcome.INDISTINGUISHABLE
    assert conclusion.indistinct == (0, 1)
