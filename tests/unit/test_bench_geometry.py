"""The clairvoyant optimum, the fixed sweep and the ratio test on cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.bench.baselines import matches
from viewsep.bench.optimum import clairvoyant_travel, telling_nodes
from viewsep.geometry import angle_between, delaunay_edges, equidistant_sphere, fibonacci_sphere, random_rotation
from viewsep.messages import BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.reachable import ReachableViews
from viewsep.planning.sweep import sweep

DIRECTIONS = equidistant_sphere(100)
EVERYWHERE = ReachableViews(fibonacci_sphere(2000), lambda directions: np.ones(directions.shape[:-1], bool))


def box(name: str, changed: BoolArray) -> AspectGraph:
    """An object all of whose views are different; those at `changed` differ from the original's too."""
    features = np.zeros((100, 320), np.float32)
    features[np.arange(100), np.arange(100) + np.where(changed, 100, 0)] = 1.0
    return AspectGraph(
        name=name,
        directions=DIRECTIONS,
        edges=delaunay_edges(DIRECTIONS),
        features=features,
        thumbnails=np.zeros((100, 1, 1, 3), np.uint8),
        descriptor="cch",
        descriptor_parameters={},
        provenance=Provenance("", "", ""),
    )


TEA = box("tea", np.zeros(100, bool))
BACK = DIRECTIONS[:, 0] < -0.6
DECAF = box("decaf", BACK)


@given(st.integers(0, 1000))
def test_the_optimum_is_the_shortest_way_to_a_view_that_differs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = random_rotation(rng)
    start = random_rotation(rng)[0]
    travel = clairvoyant_travel(TEA, [DECAF], rotation, EVERYWHERE, start)
    # by brute force: every direction belongs to its nearest node
    nodes = angle_between(EVERYWHERE.directions @ rotation, DIRECTIONS[:, None]).argmin(axis=0)
    here = int(angle_between(start @ rotation, DIRECTIONS).argmin())
    expected = 0.0 if BACK[here] else angle_between(EVERYWHERE.directions[BACK[nodes]], start).min()
    assert travel == pytest.approx(expected, abs=1e-6)


def test_there_is_no_way_where_nothing_differs_or_the_difference_is_out_of_reach() -> None:
    copy = box("copy", np.zeros(100, bool))
    start = np.array([1.0, 0.0, 0.0])
    assert clairvoyant_travel(TEA, [copy], np.eye(3), EVERYWHERE, start) == np.inf
    front = ReachableViews(
        EVERYWHERE.directions[EVERYWHERE.directions[:, 0] > 0.0], lambda directions: directions[..., 0] > 0.0
    )
    assert clairvoyant_travel(TEA, [DECAF], np.eye(3), front, start) == np.inf


def test_a_view_must_tell_the_truth_from_every_rival() -> None:
    side = DIRECTIONS[:, 1] > 0.6
    told = telling_nodes(TEA, [DECAF, box("herbal", side)], np.eye(3), EVERYWHERE)
    np.testing.assert_array_equal(told, BACK & side)


def ring(count: int) -> FloatArray:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def test_a_sweep_goes_once_around_a_ring_in_equal_steps() -> None:
    views = sweep(ring(72), ring(72)[10], 8)
    np.testing.assert_allclose(views[0], ring(72)[10])
    np.testing.assert_allclose(np.degrees(angle_between(views[1:], views[:-1])), 45.0, atol=1e-6)


@given(st.integers(1, 60), st.integers(0, 100))
def test_a_sweep_shows_different_views_spread_over_all(looks: int, seed: int) -> None:
    reachable = fibonacci_sphere(40)
    views = sweep(reachable, random_rotation(np.random.default_rng(seed))[0], looks)
    assert len(views) == min(looks, 40)
    assert len(np.unique(views, axis=0)) == len(views)
    if 4 <= looks <= 40:
        covered = angle_between(reachable[:, None], views).min(axis=1).max()
        assert covered < 2.5 * np.sqrt(4 * np.pi / len(views))


def test_features_match_where_the_best_is_much_closer_than_the_second() -> None:
    rng = np.random.default_rng(1)
    one, other = rng.normal(0, 100, (2, 30, 128)).astype(np.float32)
    doubled = np.concatenate([one[:10], one[:10]])  # nothing is much closer than the second here
    found = matches(one + 1.0, [one, other, one[:12], doubled, one[:1]])
    assert found.tolist() == [30, 0, 12, 0]
    assert matches(one, []).tolist() == []
