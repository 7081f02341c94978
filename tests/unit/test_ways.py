"""How views lie on the ways from one view to many others, on rigs that show every view, a ring, or single views."""

from __future__ import annotations

import numpy as np
import pytest

from viewsep.geometry import angle_between, azimuth_elevation, equidistant_sphere, spherical_direction
from viewsep.kinematics import preset
from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.planning.reachable import ReachableViews

STEP_RAD = float(np.radians(10.0))


def at(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    return spherical_direction(np.radians(azimuth_deg), np.radians(elevation_deg))


def single_views() -> ReachableViews:
    """96 views 15 degrees apart on four rings."""
    return ReachableViews.only(np.array([at(15 * a, e) for e in (-30, 0, 30, 60) for a in range(24)]))


def last(node: Array, there: BoolArray) -> Array:
    """(V,) the last of the indices (V, N) that there are."""
    found: Array = node[np.arange(len(node)), there.sum(axis=1) - 1]
    return found


def test_where_everything_can_be_shown_the_ways_are_great_circles() -> None:
    reachable = ReachableViews.of(preset("gimbal"))
    start = at(10.0, 20.0)
    ends = reachable.directions[::41]
    node, there, length = reachable.ways(start, ends, STEP_RAD)
    np.testing.assert_allclose(length, angle_between(start, ends), atol=1e-12)
    spacing = 1.3 * reachable.spacing_rad
    np.testing.assert_allclose(reachable.directions[last(node, there)], ends)
    for v, end in enumerate(ends):
        way = reachable.directions[node[v][there[v]]]
        assert len(way) == max(1, np.ceil(length[v] / STEP_RAD - 1e-9))
        gone = angle_between(start, way)
        expected = np.minimum(STEP_RAD * np.arange(1, len(way) + 1), length[v])
        assert np.abs(gone - expected).max() < spacing
        detour = gone + angle_between(way, end) - length[v]  # none on the great circle
        assert detour.max() < 2.0 * spacing


def test_there_are_first_those_that_there_are() -> None:
    for reachable in (ReachableViews.of(preset("gimbal")), ReachableViews.of(preset("turntable")), single_views()):
        node, there, _ = reachable.ways(reachable.directions[0], reachable.directions[5::29], STEP_RAD)
        assert node.shape == there.shape
        assert (np.diff(there.astype(int), axis=1) <= 0).all()
        assert there[:, 0].all()


@pytest.mark.parametrize("turn_deg", [6.0, 20.0, 44.0, 90.0, 120.0, 160.0, 180.0, -20.0, -120.0, -170.0])
def test_on_a_turntable_ways_are_as_long_as_the_ring(turn_deg: float) -> None:
    reachable = ReachableViews.of(preset("turntable"))
    start, end = at(0.0, 25.0), at(turn_deg, 25.0)
    node, there, (length,) = reachable.ways(start, end[None], STEP_RAD)
    assert length == pytest.approx(np.radians(abs(turn_deg)) * np.cos(np.radians(25.0)), rel=0.02)
    azimuth = np.degrees([azimuth_elevation(view)[0] for view in reachable.directions[node[0][there[0]]]])
    if abs(turn_deg) < 180.0:
        assert (np.sign(azimuth) == np.sign(turn_deg)).all()  # the short way
    assert (np.diff(np.abs(azimuth)) > 0.0).all()


@pytest.mark.parametrize("turn_deg", [6.0, 20.0, 44.0, 90.0, 120.0, -20.0, -120.0])
def test_on_a_turntable_the_end_comes_last_and_the_rest_a_step_apart(turn_deg: float) -> None:
    reachable = ReachableViews.of(preset("turntable"))
    start, end, opposite = at(0.0, 25.0), at(turn_deg, 25.0), at(180.0, 25.0)
    node, there, _ = reachable.ways(start, np.stack([end, opposite]), STEP_RAD)
    way = reachable.directions[node[0][there[0]]]
    np.testing.assert_allclose(way[-1], end, atol=1e-9)
    steps = angle_between(np.vstack([start, way[:-1]]), way)
    assert steps.max() < STEP_RAD + 2.0 * reachable.spacing_rad
    assert steps[:-1].min(initial=STEP_RAD) > STEP_RAD - 2.0 * reachable.spacing_rad
    assert len(way) == pytest.approx(steps.sum() / STEP_RAD, abs=1.1)


def test_single_views_are_reached_over_their_neighbours() -> None:
    reachable = single_views()
    start, end = at(0.0, 0.0), at(60.0, 0.0)
    node, there, (length,) = reachable.ways(start, end[None], STEP_RAD)
    way = reachable.directions[node[0][there[0]]]
    np.testing.assert_allclose(np.degrees([azimuth_elevation(view)[0] for view in way]), [15, 30, 45, 60], atol=1e-6)
    assert length == pytest.approx(np.radians(60.0))
    up = at(0.0, 60.0)
    node, there, (length,) = reachable.ways(start, up[None], STEP_RAD)
    assert length == pytest.approx(np.radians(60.0), rel=0.01)
    np.testing.assert_allclose(reachable.directions[node[0][there[0]]][-1], up)


def test_the_way_to_where_it_is_has_no_length() -> None:
    for reachable in (ReachableViews.of(preset("gimbal")), ReachableViews.of(preset("turntable")), single_views()):
        here = reachable.directions[3]
        node, there, (length,) = reachable.ways(here, here[None], STEP_RAD)
        assert length == pytest.approx(0.0, abs=1e-9)
        assert node[0][there[0]].tolist() == [3]


def test_there_is_no_way_to_what_lies_apart() -> None:
    sphere = equidistant_sphere(100)
    caps = sphere[np.abs(sphere[:, 2]) > 0.85]
    reachable = ReachableViews(caps, lambda views: np.abs(views[..., 2]) > 0.85)
    above, below = caps[caps[:, 2] > 0], caps[caps[:, 2] < 0]
    _, there, length = reachable.ways(above[0], np.stack([above[-1], below[0]]), STEP_RAD)
    assert np.isfinite(length[0])
    assert np.isinf(length[1])
    assert there[0].any()
    assert not there[1].any()
