"""Where only recorded views can be reached, planners hop from one to the next, whatever lies between them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from viewsep.geometry import (
    angle_between,
    axis_rotation,
    azimuth_elevation,
    equidistant_sphere,
    spherical_direction,
    view_edges,
)
from viewsep.interfaces import Interpretation
from viewsep.messages import Estimate, FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.exploration import GeodesicExploration, SphericalExploration
from viewsep.planning.planner import SeparatingOptions, SeparatingViewPlanner
from viewsep.planning.reachable import ReachableViews
from viewsep.planning.separating_view import similarity_graph

STEP_RAD = float(np.radians(10.0))
KINDS = pytest.mark.parametrize("kind", [GeodesicExploration, SphericalExploration])
Kind = type[GeodesicExploration] | type[SphericalExploration]


def views(*angles_deg: tuple[float, float]) -> FloatArray:
    return np.array([spherical_direction(*angles) for angles in np.radians(angles_deg)])


def ring(azimuths_deg: Iterable[float], elevation_deg: float = 25.0) -> FloatArray:
    return views(*((azimuth, elevation_deg) for azimuth in azimuths_deg))


def explored(kind: Kind, directions: FloatArray, start: int, steps: int, seed: int) -> list[int]:
    """Indices of the views shown, the start first; every one is truly one of the directions."""
    reachable = ReachableViews.only(directions)
    view, shown = directions[start], [start]
    state: GeodesicExploration | SphericalExploration = kind.start(np.random.default_rng(seed), view, STEP_RAD)
    for _ in range(steps):
        state, view = state.next_view(view, reachable)
        gaps = angle_between(directions, view)
        shown.append(int(gaps.argmin()))
        assert gaps.min() < np.radians(0.06)
    return shown


@KINDS
@pytest.mark.parametrize("step_deg", [5, 10, 15, 20, 30, 45, 90, 120])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_exploration_never_stays_where_it_is(kind: Kind, step_deg: int, seed: int) -> None:
    shown = explored(kind, ring(range(0, 360, step_deg)), 1, 60, seed)
    assert (np.diff(shown) != 0).all()


@pytest.mark.parametrize("step_deg", [5, 10, 15, 20, 30, 45, 90])
@pytest.mark.parametrize("elevation_deg", [0.0, 25.0, -60.0, 80.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_on_a_ring_exploration_goes_simply_onward(step_deg: int, elevation_deg: float, seed: int) -> None:
    count = 360 // step_deg
    shown = explored(GeodesicExploration, ring(range(0, 360, step_deg), elevation_deg), 1, count, seed)
    hops = (np.diff(shown) + count // 2) % count - count // 2
    assert len(set(np.sign(hops))) == 1 or step_deg == 90
    assert np.abs(hops).max() * step_deg <= max(step_deg, 15.0 / np.cos(np.radians(elevation_deg)))


@pytest.mark.parametrize("step_deg", [5, 10, 30])
def test_every_view_of_a_ring_with_holes_is_passed_or_shown(step_deg: int) -> None:
    held_out = [a for k, a in enumerate(range(0, 360, step_deg)) if k % 4]  # as when every 4th photo is a node
    shown = explored(GeodesicExploration, ring(held_out), 0, 360 // step_deg, 1)
    assert len(set(shown)) > 0.6 * len(held_out) or step_deg == 5  # steps of 10 deg skip some
    assert max(np.diff(sorted(set(shown)))) <= 2


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_at_the_edge_of_a_gap_exploration_turns_around(seed: int) -> None:
    arc = ring(range(0, 200, 20))
    shown = explored(GeodesicExploration, arc, 4, 40, seed)
    assert np.abs(np.diff(shown)).max() == 1
    assert set(shown) == set(range(10))


@KINDS
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_dome_of_photos_is_seen_at_several_elevations(kind: Kind, seed: int) -> None:
    dome = views(*((a, e) for e in (0, 30, 60) for a in range(0, 360, 30)))
    shown = explored(kind, dome, 3, 60, seed)
    assert (np.diff(shown) != 0).all()
    assert len(set(shown)) >= 10


def test_two_views_far_from_all_others_do_not_stop_it() -> None:
    apart = np.concatenate([ring(range(0, 60, 10)), views((180.0, -60.0))])
    assert (np.diff(explored(GeodesicExploration, apart, 6, 20, 1)) != 0).all()


def model(name: str, directions: FloatArray, difference: float, at_deg: float) -> AspectGraph:
    """A model of which the views within 25 deg of one azimuth differ by so much from all others."""
    features = np.full((len(directions), 4), 0.5)
    azimuth = np.degrees([azimuth_elevation(direction)[0] for direction in directions])
    features[np.abs((azimuth - at_deg + 180.0) % 360.0 - 180.0) <= 25.0] += difference
    return AspectGraph(
        name=name,
        directions=directions,
        edges=view_edges(directions),
        features=features.astype(np.float32),
        thumbnails=np.zeros((len(directions), 1, 1, 3), np.uint8),
        descriptor="made by hand",
        descriptor_parameters={},
        provenance=Provenance("none", "none", "none"),
    )


def belief(*rotations: FloatArray) -> Interpretation:
    estimate = Estimate(0, 1, Phase.EXPLORING, (), 0, 0.0, None)
    return Interpretation(estimate, np.array(rotations), True, np.full(len(rotations), True), 0, False)


@pytest.mark.parametrize("node_step", [5, 10, 20, 30])
@pytest.mark.parametrize("shown_step", [5, 10, 15, 30, 45])
@pytest.mark.parametrize("elevation_deg", [0.0, 25.0, 60.0])
def test_on_a_ring_the_separating_view_is_found_and_approached(
    node_step: int, shown_step: int, elevation_deg: float
) -> None:
    nodes = ring(range(0, 360, node_step), elevation_deg)
    shown = ring(np.arange(2.5, 360, shown_step), elevation_deg)
    models = [model("a", nodes, 0.0, 140.0), model("b", nodes, 1.0, 140.0)]
    planner = SeparatingViewPlanner(models, ReachableViews.only(shown), SeparatingOptions(start="current"))
    view = shown[0]
    state, _ = planner.start(0, view)
    for _ in range(40):
        state, wanted = planner.next_view(state, view, belief(np.eye(3), np.eye(3)))
        assert wanted.view_direction is not None
        assert wanted.purpose is Phase.APPROACHING
        view = wanted.view_direction
        assert angle_between(shown, view).min() < 1e-3
        if wanted.arrives:
            break
    azimuth = np.degrees(azimuth_elevation(view)[0])
    assert abs((azimuth - 140.0 + 180.0) % 360.0 - 180.0) <= 45.0


def test_nothing_is_said_where_a_candidate_has_no_views() -> None:
    whole, half = equidistant_sphere(100), np.array([v for v in equidistant_sphere(100) if v[2] > 0])
    graph = similarity_graph([model("a", whole, 1.0, 0.0), model("b", half, 0.0, 0.0)], np.array([np.eye(3)] * 2))
    height = graph.directions[:, 2]
    assert graph.known[height > 0.0].all()
    assert not graph.known[height < -np.sin(np.radians(40.0))].any()
    assert (graph.smoothed[~graph.known] == 0.0).all()
    assert (graph.variance[~graph.known] == 0.0).all()
    everywhere = similarity_graph([model("a", whole, 1.0, 0.0), model("b", whole, 0.0, 0.0)], np.array([np.eye(3)] * 2))
    assert everywhere.known.all()


def test_rings_in_poses_that_do_not_meet_leave_only_their_crossings() -> None:
    nodes = ring(range(0, 360, 10), 0.0)
    models = [model("a", nodes, 1.0, 90.0), model("b", nodes, 0.0, 90.0)]
    upright, lying = np.eye(3), axis_rotation(np.array([1.0, 0.0, 0.0]), np.pi / 2)
    graph = similarity_graph(models, np.array([upright, lying]))
    crossing = np.abs(graph.directions[:, 0])
    assert 0 < graph.known.sum() < 20
    assert crossing[graph.known].min() > np.cos(np.radians(35.0))
    away = views(*((a, 0.0) for a in range(60, 130, 10)))  # all that can be reached lies where nothing is known
    planner = SeparatingViewPlanner(models, ReachableViews.only(away), SeparatingOptions(start="current"))
    state, _ = planner.start(0, away[0])
    _, wanted = planner.next_view(state, away[0], belief(upright, lying))
    assert wanted.purpose is Phase.EXPLORING


def test_the_way_between_photos_leads_over_photos() -> None:
    shown = ring(a for k, a in enumerate(range(0, 360, 5)) if k % 4)
    reachable = ReachableViews.only(shown)
    way = reachable.path(shown[2], shown[25], STEP_RAD)
    assert all(reachable.reaches(view) for view in way)
    np.testing.assert_array_equal(way[-1], shown[25])
    steps = angle_between(np.vstack([shown[2], way[:-1]]), way)
    assert np.degrees(steps.max()) < 25.0
