"""Views are neighbours of those around them, whatever part of the sphere they cover, and never across a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from viewsep.geometry import (
    angle_between,
    delaunay_edges,
    equidistant_sphere,
    fibonacci_sphere,
    random_rotation,
    spherical_direction,
    view_edges,
)
from viewsep.messages import Array, FloatArray

SPHERE = equidistant_sphere(200)


def views(*angles_deg: tuple[float, float]) -> FloatArray:
    return np.array([spherical_direction(*angles) for angles in np.radians(angles_deg)])


def grid(azimuth_step: int, elevations: range) -> FloatArray:
    return views(*((a, e) for e in elevations for a in range(0, 360, azimuth_step)))


def pairs(edges: Array) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in edges}


def lengths_deg(directions: FloatArray) -> FloatArray:
    a, b = view_edges(directions).T
    return np.degrees(angle_between(directions[a], directions[b]))


def whole_ring(count: int) -> set[tuple[int, int]]:
    return {(k, k + 1) for k in range(count - 1)} | {(0, count - 1)}


def connected(edges: Array, count: int) -> bool:
    pieces, _ = connected_components(csr_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(count, count)))
    return bool(pieces == 1)


@pytest.mark.parametrize("count", [12, 13, 20, 42, 60, 100, 150])
@pytest.mark.parametrize("sphere", [equidistant_sphere, fibonacci_sphere])
def test_on_whole_spheres_they_are_the_delaunay_edges(sphere: type, count: int) -> None:
    directions = sphere(count)
    np.testing.assert_array_equal(view_edges(directions), delaunay_edges(directions))


@given(
    count=st.integers(4, 80),
    elevation_deg=st.floats(-75, 75),
    seed=st.integers(0, 999),
    noise=st.floats(0, 0.03),
)
def test_on_a_ring_they_join_consecutive_views_however_it_lies(
    count: int, elevation_deg: float, seed: int, noise: float
) -> None:
    rng = np.random.default_rng(seed)
    step = 360.0 / count
    around, up = rng.uniform(-noise, noise, (2, count)) * step
    ring = views(
        *((k * step + around[k], elevation_deg + up[k] * np.cos(np.radians(elevation_deg))) for k in range(count))
    )
    assert pairs(view_edges(ring @ random_rotation(rng).T)) == whole_ring(count)


@given(missing=st.sets(st.integers(0, 71), max_size=30), elevation_deg=st.floats(-80, 80), turn=st.integers(0, 359))
def test_a_gap_in_a_ring_is_not_bridged(missing: set[int], elevation_deg: float, turn: int) -> None:
    kept = [k for k in range(72) if k not in missing]
    edges = view_edges(views(*((5.0 * k + turn, elevation_deg) for k in kept)))
    steps = np.diff(kept, append=kept[0] + 72)
    expected = {
        tuple(sorted((k, (k + 1) % len(kept)))) for k, step in enumerate(steps) if step <= 1.6 * np.median(steps)
    }
    assert pairs(edges) == expected


def test_an_arc_has_two_ends() -> None:
    assert pairs(view_edges(views(*((a, 25.0) for a in range(0, 130, 10))))) == {(k, k + 1) for k in range(12)}
    assert pairs(view_edges(views(*((40.0, e) for e in range(-40, 50, 10))))) == {(k, k + 1) for k in range(8)}


def test_views_from_opposite_sides_are_no_neighbours() -> None:
    assert pairs(view_edges(views(*((a, 0.0) for a in range(0, 360, 90))))) == whole_ring(4)
    assert len(view_edges(views(*((a, 0.0) for a in range(0, 360, 120))))) == 0
    assert len(view_edges(views(*((a, -19.5) for a in range(0, 360, 120)), (0.0, 90.0)))) == 0  # a tetrahedron


def test_fewer_than_three_views_have_no_neighbours() -> None:
    for count in range(3):
        edges = view_edges(fibonacci_sphere(12)[:count])
        assert edges.shape == (0, 2)
        assert edges.dtype == np.int32


@pytest.mark.parametrize(
    ("azimuth_step", "elevations"),
    [
        (10, range(0, 90, 10)),
        (5, range(0, 90, 30)),
        (20, range(-60, 80, 20)),
        (45, range(-45, 60, 45)),
        (15, range(10, 40, 20)),
        (20, range(0, 80, 40)),
    ],
)
def test_on_grids_of_azimuth_and_elevation_they_join_the_corners_of_cells(azimuth_step: int, elevations: range) -> None:
    directions = grid(azimuth_step, elevations)
    rings, around = len(elevations), 360 // azimuth_step
    edges = view_edges(directions)
    ring, place = np.divmod(edges, around)
    apart = np.abs(place[:, 0] - place[:, 1])
    assert (np.abs(ring[:, 0] - ring[:, 1]) <= 1).all()
    assert (np.minimum(apart, around - apart) <= 1).all()
    assert len(edges) == rings * around + 2 * (rings - 1) * around  # along the rings, between them, one diagonal each


@given(seed=st.integers(0, 999), lowest=st.floats(-0.6, 0.6))
def test_what_was_not_covered_is_not_bridged(seed: int, lowest: float) -> None:
    whole = SPHERE @ random_rotation(np.random.default_rng(seed)).T
    part = whole[whole[:, 2] > lowest]
    assert lengths_deg(part).max() < 1.7 * lengths_deg(whole).mean()  # along the rim; a missing view makes 2
    assert connected(view_edges(part), len(part))


@pytest.mark.parametrize("missing", [3, 40, 77])
def test_one_missing_view_leaves_a_hole(missing: int) -> None:
    whole = equidistant_sphere(100)
    kept = np.arange(100) != missing
    place = np.cumsum(kept) - 1
    left = {(int(place[a]), int(place[b])) for a, b in delaunay_edges(whole) if kept[a] and kept[b]}
    got = pairs(view_edges(whole[kept]))
    assert left <= got
    assert len(got - left) <= 2  # at most where the ring around the hole is narrow
    assert lengths_deg(whole[kept]).max() < 1.6 * lengths_deg(whole).mean()


def test_a_view_missing_from_a_square_grid_leaves_a_hole() -> None:
    angles = [(a, e) for e in range(-20, 30, 10) for a in range(0, 60, 10)]
    angles.remove((20, 0))
    assert lengths_deg(views(*angles)).max() < 15.0


def test_a_ring_with_a_short_second_one_stays_a_ring() -> None:
    directions = views(*((a, 0.0) for a in range(0, 360, 5)), *((a, 60.0) for a in range(0, 60, 5)))
    assert whole_ring(72) <= pairs(view_edges(directions))


@given(seed=st.integers(0, 999), count=st.integers(4, 40))
def test_turning_the_object_or_listing_views_in_another_order_changes_nothing(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    directions = fibonacci_sphere(3 * count)[:count]
    order = rng.permutation(count)
    edges = view_edges(directions)
    again = view_edges(directions[order] @ random_rotation(rng).T)
    assert pairs(np.sort(order[again], axis=1)) == pairs(edges)
    assert (edges[:, 0] < edges[:, 1]).all()
    assert edges.dtype == np.int32
