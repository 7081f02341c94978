"""Planners ask only for views the rig can show, move on while they explore, and drive to where candidates differ."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
import pytest

from viewsep.geometry import (
    angle_between,
    azimuth_elevation,
    delaunay_edges,
    equidistant_sphere,
    great_circle,
    spherical_direction,
)
from viewsep.interfaces import Interpretation
from viewsep.kinematics import PRESETS, preset
from viewsep.messages import Array, Estimate, FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.exploration import GeodesicExploration, SphericalExploration
from viewsep.planning.planner import PlannerState, SeparatingOptions, SeparatingViewPlanner
from viewsep.planning.random_motion import RandomPlanner
from viewsep.planning.reachable import ReachableViews
from viewsep.planning.separating_view import similarity_graph
from viewsep.planning.sweep import SweepPlanner, sweep

STEP_RAD = float(np.radians(10.0))
NODES = equidistant_sphere(100)
EDGES = delaunay_edges(NODES)
EVERY_PRESET = pytest.mark.parametrize("name", PRESETS)


@cache
def views_of(name: str) -> ReachableViews:
    return ReachableViews.of(preset(name))


def at(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    return spherical_direction(np.radians(azimuth_deg), np.radians(elevation_deg))


def drawn(name: str, count: int, seed: int = 0) -> FloatArray:
    """Random reachable views."""
    directions = views_of(name).directions
    return directions[np.random.default_rng(seed).integers(len(directions), size=count)]


def gaps(start: FloatArray, way: FloatArray) -> FloatArray:
    return angle_between(np.vstack([start, way[:-1]]), way)


def test_a_view_that_can_be_reached_is_its_own_nearest() -> None:
    view = at(12.3, 25.0)
    np.testing.assert_array_equal(views_of("turntable").nearest(view), view)
    ring = views_of("turntable").nearest(at(12.3, 60.0))
    assert np.degrees(azimuth_elevation(ring)) == pytest.approx((12.3, 25.0), abs=1.1)


def test_the_path_is_the_great_circle_where_all_of_it_can_be_reached() -> None:
    reachable, ends = views_of("gimbal"), drawn("gimbal", 10)
    pairs = [*zip(ends[::2], ends[1::2], strict=True), (at(0, 89), at(180, 80)), (ends[0], -ends[0])]
    for start, end in pairs:
        np.testing.assert_array_equal(reachable.path(start, end, STEP_RAD), great_circle(start, end, STEP_RAD))


@pytest.mark.parametrize("turn_deg", [3.0, 15.0, 90.0, 179.0, 180.0, 181.0, -120.0])
def test_the_path_on_a_turntable_goes_around_the_ring_the_short_way(turn_deg: float) -> None:
    reachable = views_of("turntable")
    start, end = at(20.0, 25.0), at(20.0 + turn_deg, 25.0)
    way = reachable.path(start, end, STEP_RAD)
    np.testing.assert_array_equal(way[-1], end)
    assert all(reachable.reaches(view) for view in way)
    assert gaps(start, way).max() <= 2.0 * STEP_RAD
    azimuth = np.unwrap([azimuth_elevation(view)[0] for view in [start, *way]])
    turned_deg = np.degrees(np.diff(azimuth))
    shortest = min(abs(turn_deg), 360.0 - abs(turn_deg))
    assert np.abs(turned_deg).sum() == pytest.approx(shortest, abs=2.1)  # all in one sense, none twice


@pytest.mark.parametrize("name", ["pan_tilt", "wrist"])
def test_every_waypoint_between_random_views_is_reachable_and_not_far(name: str) -> None:
    reachable = views_of(name)
    ends = drawn(name, 24)
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        way = reachable.path(start, end, STEP_RAD)
        np.testing.assert_array_equal(way[-1], end)
        assert all(reachable.reaches(view) for view in way)
        assert gaps(start, way).max() <= 2.0 * STEP_RAD
        assert gaps(start, way).sum() <= 1.5 * float(angle_between(start, end)) + STEP_RAD


def test_the_path_goes_around_what_cannot_be_reached() -> None:
    reachable = views_of("pan_tilt")  # not the poles: at most 80 deg of elevation
    start, end = at(0.0, 70.0), at(180.0, 70.0)
    assert not all(reachable.reaches(view) for view in great_circle(start, end, STEP_RAD))
    way = reachable.path(start, end, STEP_RAD)
    assert all(reachable.reaches(view) for view in way)
    assert gaps(start, way).max() <= 2.0 * STEP_RAD


def test_views_that_fall_apart_leave_the_end_alone() -> None:
    caps = np.array([view for view in NODES if abs(view[2]) > 0.85])
    reachable = ReachableViews(caps, lambda views: np.abs(views[..., 2]) > 0.85)
    np.testing.assert_array_equal(reachable.path(caps[0], caps[-1], STEP_RAD), caps[-1:])


def explored(
    kind: type[GeodesicExploration] | type[SphericalExploration],
    name: str,
    seed: int,
    start: FloatArray,
    steps: int = 60,
) -> FloatArray:
    """(steps + 1, 3) views."""
    state = kind.start(np.random.default_rng(seed), start, STEP_RAD)
    views = [start]
    for _ in range(steps):
        state, view = state.next_view(views[-1], views_of(name))
        views.append(view)
    return np.array(views)


def nodes_seen(views: FloatArray) -> int:
    return len(np.unique(angle_between(views[:, None], NODES[None]).argmin(axis=1)))


@EVERY_PRESET
@pytest.mark.parametrize("kind", [GeodesicExploration, SphericalExploration])
@pytest.mark.parametrize("seed", [1, 2])
def test_exploration_moves_on_through_reachable_views_and_sees_new_ones(
    name: str, kind: type[GeodesicExploration] | type[SphericalExploration], seed: int
) -> None:
    views = explored(kind, name, seed, drawn(name, 1, seed)[0])
    assert all(views_of(name).reaches(view) for view in views)
    assert np.degrees(gaps(views[0], views[1:])).min() > 0.5
    assert nodes_seen(views) >= 12  # a ring has 21 of 100


@EVERY_PRESET
@pytest.mark.parametrize("seed", [3, 4])
def test_geodesic_exploration_keeps_its_pace_and_away_from_the_pole(name: str, seed: int) -> None:
    start = next(view for view in drawn(name, 20, seed) if abs(azimuth_elevation(view)[1]) < np.radians(60.0))
    views = explored(GeodesicExploration, name, seed, start)
    steps = gaps(views[0], views[1:])
    assert steps.min() > 0.5 * STEP_RAD
    assert steps.max() < 1.5 * STEP_RAD
    assert np.degrees(np.arcsin(np.abs(views[:, 2]).max())) <= 75.0 + 1e-6
    assert nodes_seen(views) >= 18


def test_geodesic_exploration_leaves_the_pole() -> None:
    views = explored(GeodesicExploration, "gimbal", 0, at(0.0, 90.0))
    assert np.degrees(np.arcsin(np.abs(views[9:, 2]).max())) <= 75.0 + 1e-6


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_further_turns_of_the_geodesic_exploration_show_new_views(seed: int) -> None:
    views = explored(GeodesicExploration, "gimbal", seed, at(0.0, 0.0), steps=108)
    first_turn, two_turns = nodes_seen(views[:37]), nodes_seen(views[:73])
    assert two_turns > 1.4 * first_turn
    assert nodes_seen(views) > two_turns + 5


def test_spherical_exploration_steps_by_constant_angles() -> None:
    views = explored(SphericalExploration, "gimbal", 1, at(0.0, 0.0))
    state = SphericalExploration.start(np.random.default_rng(1), views[0], STEP_RAD)
    assert np.hypot(state.azimuth_step_rad, state.elevation_step_rad) == pytest.approx(STEP_RAD)
    for step, view in enumerate(views):
        expected = spherical_direction(step * state.azimuth_step_rad, step * state.elevation_step_rad)
        np.testing.assert_allclose(view, expected, atol=1e-9)


def model(name: str, *differences: tuple[FloatArray, float]) -> AspectGraph:
    """A model whose views within 25 deg of each given direction differ by the given amount from all others."""
    features = np.random.default_rng(9).random((len(NODES), 8))
    for centre, amount in differences:
        features[angle_between(NODES, centre) < np.radians(25.0)] += amount
    return AspectGraph(
        name=name,
        directions=NODES,
        edges=EDGES,
        features=features.astype(np.float32),
        thumbnails=np.zeros((len(NODES), 1, 1, 3), np.uint8),
        descriptor="made by hand",
        descriptor_parameters={},
        provenance=Provenance("none", "none", "none"),
    )


def belief(rotations: FloatArray, converged: bool = True, plausible: Sequence[bool] | None = None) -> Interpretation:
    worth: Array = np.array([True] * len(rotations) if plausible is None else plausible)
    return Interpretation(Estimate(0, 1, Phase.EXPLORING, (), 0, 0.0, None), rotations, converged, worth, 0, False)


def upright(count: int) -> FloatArray:
    return np.array([np.eye(3)] * count)


def planner_on(name: str, models: Sequence[AspectGraph], start: Literal["random", "current"]) -> SeparatingViewPlanner:
    return SeparatingViewPlanner(models, views_of(name), SeparatingOptions(start=start))


def drive(
    planner: SeparatingViewPlanner, state: PlannerState, view: FloatArray, known: Interpretation
) -> tuple[PlannerState, FloatArray, bool]:
    """Follow the planner until it has arrived at a target (True) or asks for a step of exploration (False)."""
    for _ in range(60):
        state, wanted = planner.next_view(state, view, known)
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        assert (wanted.target is None) == (wanted.purpose is Phase.EXPLORING)
        view = wanted.view_direction
        if wanted.target is None:
            return state, view, False
        if wanted.arrives:
            np.testing.assert_array_equal(view, wanted.target)
            return state, view, True
    raise AssertionError("the planner never arrived")


def first_target(planner: SeparatingViewPlanner, start: FloatArray, known: Interpretation) -> FloatArray | None:
    state, _ = planner.start(0, start)
    _, view, arrived = drive(planner, state, start, known)
    return view if arrived else None


@EVERY_PRESET
def test_a_task_starts_at_a_random_reachable_view_that_the_seed_decides(name: str) -> None:
    planner = planner_on(name, [model("a")], "random")
    here = drawn(name, 1)[0]
    starts = []
    for seed in (1, 1, 2, 3):
        _, wanted = planner.start(seed, here)
        assert wanted.purpose is Phase.STARTING
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        starts.append(wanted.view_direction.tolist())
    assert starts[0] == starts[1]
    assert len({tuple(start) for start in starts}) == 3


def test_a_task_can_start_where_the_rig_is() -> None:
    _, wanted = planner_on("turntable", [model("a")], "current").start(1, at(0.0, 25.0))
    assert wanted.view_direction is None


@pytest.mark.parametrize(("name", "elevation_deg"), [("turntable", 25.0), ("gimbal", -60.0), ("gimbal", 90.0)])
def test_the_target_lies_where_the_candidates_differ(name: str, elevation_deg: float) -> None:
    centre = at(140.0, elevation_deg)
    planner = planner_on(name, [model("a"), model("b", (centre, 1.0))], "current")
    target = first_target(planner, drawn(name, 1)[0], belief(upright(2)))
    assert target is not None
    assert np.degrees(float(angle_between(target, centre))) < 20.0


def test_the_candidates_are_compared_in_the_poses_they_were_found_in() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # object -> control, 90 deg about z
    planner = planner_on("gimbal", [model("a"), model("b", (at(140.0, 10.0), 1.0))], "current")
    target = first_target(planner, at(0.0, 0.0), belief(np.array([turn, turn])))
    assert target is not None
    assert np.degrees(float(angle_between(target, at(230.0, 10.0)))) < 20.0


def test_a_turntable_settles_for_the_best_view_it_can_reach() -> None:
    below, weak = at(0.0, -90.0), at(140.0, 25.0)
    planner = planner_on("turntable", [model("a"), model("b", (below, 5.0), (weak, 0.2))], "current")
    target = first_target(planner, at(0.0, 25.0), belief(upright(2)))
    assert target is not None
    assert np.degrees(float(angle_between(target, weak))) < 20.0


def test_without_a_reachable_difference_a_turntable_explores_on() -> None:
    planner = planner_on("turntable", [model("a"), model("b", (at(0.0, -90.0), 5.0))], "current")
    assert first_target(planner, at(0.0, 25.0), belief(upright(2))) is None


def test_only_plausible_candidates_count() -> None:
    models = [model("a"), model("b", (at(40.0, 25.0), 0.5)), model("c", (at(200.0, 25.0), 5.0))]
    target = first_target(
        planner_on("turntable", models, "current"), at(100.0, 25.0), belief(upright(3), plausible=[True, True, False])
    )
    assert target is not None
    assert np.degrees(float(angle_between(target, at(40.0, 25.0)))) < 20.0


@pytest.mark.parametrize("name", ["turntable", "gimbal"])
def test_after_a_target_comes_another_one_apart_from_all_before_and_at_last_exploration(name: str) -> None:
    planner = planner_on(name, [model("a"), model("b", (at(40.0, 25.0), 1.0), (at(200.0, 25.0), 0.8))], "current")
    view, known = at(100.0, 25.0), belief(upright(2))
    state, _ = planner.start(0, view)
    visited: list[FloatArray] = []
    while True:
        state, view, arrived = drive(planner, state, view, known)
        if not arrived:
            break
        assert all(float(angle_between(view, other)) >= np.radians(30.0) for other in visited)
        visited.append(view)
    assert 2 <= len(visited) < 15
    assert np.degrees(float(angle_between(visited[0], at(40.0, 25.0)))) < 20.0
    assert np.degrees(float(angle_between(visited[1], at(200.0, 25.0)))) < 20.0
    _, again, arrived = drive(planner, state, view, known)
    assert arrived
    np.testing.assert_array_equal(again, visited[0])


def test_a_plan_is_followed_to_its_end_though_the_belief_changes() -> None:
    planner = planner_on("turntable", [model("a"), model("b", (at(140.0, 25.0), 1.0))], "current")
    view = at(0.0, 25.0)
    state, _ = planner.start(0, view)
    state, wanted = planner.next_view(state, view, belief(upright(2)))
    assert wanted.view_direction is not None
    _, second = planner.next_view(state, wanted.view_direction, belief(upright(2), converged=False))
    assert second.purpose is Phase.APPROACHING
    np.testing.assert_array_equal(second.target, wanted.target)


@pytest.mark.parametrize("known", [None, belief(upright(2), converged=False)], ids=["no belief", "not converged"])
def test_until_the_poses_have_converged_the_planner_explores(known: Interpretation | None) -> None:
    planner = planner_on("turntable", [model("a"), model("b", (at(140.0, 25.0), 1.0))], "current")
    view = at(0.0, 25.0)
    state, _ = planner.start(0, view)
    for _ in range(10):
        state, wanted = planner.next_view(state, view, known)
        assert wanted.purpose is Phase.EXPLORING
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        view = wanted.view_direction


@pytest.mark.parametrize("count", [1, 2])
def test_identical_candidates_leave_nothing_to_approach(count: int) -> None:
    planner = planner_on("turntable", [model(f"twin {k}") for k in range(count)], "current")
    view = at(0.0, 25.0)
    state, _ = planner.start(0, view)
    for _ in range(3):
        state, wanted = planner.next_view(state, view, belief(upright(count)))
        assert wanted.purpose is Phase.EXPLORING
        assert wanted.view_direction is not None
        view = wanted.view_direction


def test_planning_does_not_change_the_state_it_was_given() -> None:
    planner = planner_on("turntable", [model("a"), model("b", (at(140.0, 25.0), 1.0))], "current")
    view = at(0.0, 25.0)
    state, _ = planner.start(0, view)
    once = [wanted.view_direction for _, wanted in (planner.next_view(state, view, None) for _ in range(2))]
    np.testing.assert_array_equal(once[0], once[1])
    approach = [wanted.target for _, wanted in (planner.next_view(state, view, belief(upright(2))) for _ in range(2))]
    np.testing.assert_array_equal(approach[0], approach[1])
    assert len(state.way) == len(state.visited) == 0


def test_the_similarity_graph_peaks_where_models_differ_and_is_zero_where_they_do_not() -> None:
    centre = at(140.0, 25.0)
    graph = similarity_graph([model("a"), model("b", (centre, 1.0))], upright(2))
    away = angle_between(graph.directions, centre)
    assert graph.smoothed[away > np.radians(70.0)].max() == 0.0
    assert np.degrees(away[graph.smoothed.argmax()]) < 20.0
    np.testing.assert_allclose(graph.variance[away < np.radians(20.0)], 8 * 0.25, rtol=1e-5)


@EVERY_PRESET
def test_random_motion_goes_all_over_and_is_judged_everywhere_once_the_poses_have_converged(name: str) -> None:
    planner = RandomPlanner([model("a")], views_of(name))
    here = drawn(name, 1)[0]
    state, first = planner.start(4, here)
    assert first.view_direction is not None
    start = planner_on(name, [model("a")], "random").start(4, here)[1].view_direction
    np.testing.assert_array_equal(first.view_direction, start)
    views = [first.view_direction]
    for look in range(200):
        known = None if look < 50 else belief(upright(1), converged=look >= 100)
        state, wanted = planner.next_view(state, views[-1], known)
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        assert wanted.arrives == (look >= 100)
        views.append(wanted.view_direction)
    assert gaps(views[0], np.array(views[1:])).max() <= 2.5 * STEP_RAD
    unseen = angle_between(planner.reachable.directions[:, None], np.array(views)).min(axis=1)
    assert np.median(unseen) < 2.0 * STEP_RAD


@pytest.mark.parametrize(("name", "looks"), [("turntable", 60), ("pan_tilt", 400), ("gimbal", 400)])
def test_a_sweep_sees_everything_and_then_what_lies_between(name: str, looks: int) -> None:
    planner = SweepPlanner([model("a")], views_of(name))
    here = drawn(name, 1)[0]
    state, first = planner.start(4, here)
    assert first.view_direction is not None
    start = planner_on(name, [model("a")], "random").start(4, here)[1].view_direction
    np.testing.assert_array_equal(first.view_direction, start)
    passed = [first.view_direction]
    while state.sweeps < 2 or len(state.left) > 0:
        if state.sweeps == 1 and len(state.left) + len(state.way) == 0:
            gap = angle_between(planner.reachable.directions[:, None], np.array(passed)).min(axis=1)
            assert np.degrees(gap).max() <= 20.0 + 1e-6
        known = None if len(passed) < 20 else belief(upright(1), converged=len(passed) >= 40)
        state, wanted = planner.next_view(state, passed[-1], known)
        assert wanted.view_direction is not None
        assert planner.reachable.reaches(wanted.view_direction)
        assert wanted.arrives == (len(passed) >= 40)
        passed.append(wanted.view_direction)
    assert len(passed) <= 2 * looks
    gap = angle_between(planner.reachable.directions[:, None], np.array(passed)).min(axis=1)
    assert np.degrees(gap).max() <= 15.0
    assert gaps(passed[0], np.array(passed[1:])).max() <= 2.5 * STEP_RAD


def test_a_sweep_ends_where_nothing_is_far_from_it() -> None:
    directions = views_of("gimbal").directions
    for apart_deg in (15.0, 40.0):
        views = sweep(directions, directions[7], apart_rad=np.radians(apart_deg))
        assert angle_between(directions[:, None], views).min(axis=1).max() <= np.radians(apart_deg)
        assert len(sweep(directions, directions[7], len(views) - 1)) == len(views) - 1
    assert len(sweep(directions, directions[7], apart_rad=4.0)) == 2
