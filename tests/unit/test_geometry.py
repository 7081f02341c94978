"""Unit vectors, rotations, arcs and the view sphere keep their promises, poles and opposite points included."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from viewsep.geometry import (
    angle_between,
    axis_rotation,
    azimuth_elevation,
    delaunay_edges,
    equidistant_sphere,
    fibonacci_sphere,
    great_circle,
    matrix_to_quaternion,
    mean_rotation,
    move_along,
    nearest_rotation,
    perpendicular,
    quaternion_to_matrix,
    random_rotation,
    rotation_angle,
    rotation_showing,
    spherical_direction,
    tangent_towards,
    unit,
)
from viewsep.messages import FloatArray

EXACT = 1e-12


def _long_enough(values: list[float]) -> bool:
    return float(np.linalg.norm(values)) > 0.1


def _unit(values: list[float]) -> FloatArray:
    return unit(np.array(values))


def numbers(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-1.0, 1.0), min_size=count, max_size=count).filter(_long_enough)


poles = st.sampled_from([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
directions = st.one_of(numbers(3).map(_unit), poles)
quaternions = numbers(4).map(_unit)
rotations = quaternions.map(quaternion_to_matrix)
angles = st.floats(-7.0, 7.0)


def assert_rotation(matrix: FloatArray, tolerance: float = EXACT) -> None:
    np.testing.assert_allclose(
        matrix @ matrix.swapaxes(-1, -2), np.broadcast_to(np.eye(3), matrix.shape), atol=tolerance
    )
    np.testing.assert_allclose(np.linalg.det(matrix), 1.0, atol=tolerance)


def test_unit_scales_to_length_one_and_leaves_zero_alone() -> None:
    vectors = np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0], [1e-200, 0.0, 0.0]])
    np.testing.assert_allclose(unit(vectors)[:2], [[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]], atol=EXACT)
    assert np.isfinite(unit(vectors)).all()


@given(directions, directions)
def test_the_angle_is_symmetric_and_in_range(a: FloatArray, b: FloatArray) -> None:
    angle = float(angle_between(a, b))
    assert angle == float(angle_between(b, a))
    assert 0.0 <= angle <= np.pi
    assert np.cos(angle) == pytest.approx(float(a @ b), abs=EXACT)
    assert angle + float(angle_between(a, -b)) == pytest.approx(np.pi, abs=EXACT)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 1e-3])
@given(directions)
def test_small_angles_and_angles_near_a_half_turn_are_exact(angle: float, start: FloatArray) -> None:
    end = move_along(start, perpendicular(start), angle)
    assert float(angle_between(start, end)) == pytest.approx(angle, abs=1e-15)
    assert np.pi - float(angle_between(start, -end)) == pytest.approx(angle, abs=1e-15)


def test_the_angle_is_taken_over_the_last_axis() -> None:
    views = fibonacci_sphere(7)
    assert angle_between(views[:, None], views[None]).shape == (7, 7)
    np.testing.assert_array_equal(np.diag(angle_between(views[:, None], views[None])), 0.0)


@given(st.floats(-np.pi + 1e-6, np.pi), st.floats(-np.pi / 2 + 1e-6, np.pi / 2 - 1e-6))
def test_azimuth_and_elevation_come_back_from_a_direction(azimuth: float, elevation: float) -> None:
    direction = spherical_direction(azimuth, elevation)
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=EXACT)
    assert azimuth_elevation(direction) == pytest.approx((azimuth, elevation), abs=1e-9)


def test_an_elevation_beyond_the_pole_goes_over_it() -> None:
    azimuth, elevation = azimuth_elevation(spherical_direction(0.0, np.radians(100.0)))
    assert abs(np.degrees(azimuth)) == pytest.approx(180.0)
    assert np.degrees(elevation) == pytest.approx(80.0)


@given(directions, angles, directions)
def test_an_axis_rotation_turns_right_handed_about_its_axis(axis: FloatArray, angle: float, other: FloatArray) -> None:
    rotation = axis_rotation(axis, angle)
    assert_rotation(rotation)
    np.testing.assert_allclose(rotation @ axis, axis, atol=EXACT)
    side = perpendicular(axis)
    turned = np.cos(angle) * side + np.sin(angle) * np.cross(axis, side)
    np.testing.assert_allclose(rotation @ side, turned, atol=EXACT)
    np.testing.assert_allclose(axis_rotation(axis, -angle) @ (rotation @ other), other, atol=EXACT)


@given(quaternions)
def test_quaternion_and_matrix_are_inverse(xyzw: FloatArray) -> None:
    matrix = quaternion_to_matrix(xyzw)
    assert_rotation(matrix)
    back = matrix_to_quaternion(matrix)
    assert back[3] >= 0.0
    assert abs(float(back @ xyzw)) == pytest.approx(1.0, abs=EXACT)
    np.testing.assert_allclose(quaternion_to_matrix(back), matrix, atol=EXACT)


def test_random_rotations_are_seeded_and_spread_over_all_of_so3() -> None:
    drawn = np.array([random_rotation(np.random.default_rng(seed)) for seed in range(2000)])
    assert_rotation(drawn)
    np.testing.assert_array_equal(drawn[3], random_rotation(np.random.default_rng(3)))
    np.testing.assert_allclose(drawn.mean(axis=0), np.zeros((3, 3)), atol=0.05)
    # uniform over SO(3): the mean rotation angle is pi/2 + 2/pi
    assert float(rotation_angle(drawn, np.eye(3)).mean()) == pytest.approx(np.pi / 2 + 2 / np.pi, abs=0.05)


@given(rotations, directions, st.floats(0.0, np.pi))
def test_the_rotation_angle_is_the_angle_turned(start: FloatArray, axis: FloatArray, angle: float) -> None:
    end = start @ axis_rotation(axis, angle)
    assert float(rotation_angle(start, end)) == pytest.approx(angle, abs=1e-7)
    assert float(rotation_angle(end, start)) == pytest.approx(angle, abs=1e-7)


def test_a_tiny_rotation_angle_is_exact() -> None:
    tiny = axis_rotation(unit(np.array([1.0, 2.0, 3.0])), 1e-9)
    assert float(rotation_angle(np.eye(3), tiny)) == pytest.approx(1e-9, rel=1e-6)


@given(st.lists(st.floats(-2.0, 2.0), min_size=9, max_size=9))
def test_the_nearest_rotation_beats_random_ones(values: list[float]) -> None:
    matrix = np.array(values).reshape(3, 3)
    nearest = nearest_rotation(matrix)
    assert_rotation(nearest, 1e-9)
    rng = np.random.default_rng(0)
    others = [random_rotation(rng) for _ in range(50)]
    others += [nearest @ axis_rotation(axis, angle) for axis in np.eye(3) for angle in (-0.01, 0.01, np.pi)]
    assert np.trace(nearest.T @ matrix) >= max(np.trace(other.T @ matrix) for other in others) - 1e-9


@given(rotations)
def test_the_nearest_rotation_of_a_rotation_or_its_mirror_image_is_a_rotation(rotation: FloatArray) -> None:
    np.testing.assert_allclose(nearest_rotation(2.5 * rotation), rotation, atol=1e-9)
    mirrored = np.array([rotation, rotation @ np.diag([1.0, 1.0, -1.0])])
    assert_rotation(nearest_rotation(mirrored), 1e-9)


@given(rotations, st.lists(st.tuples(directions, st.floats(0.0, 1.4)), min_size=1, max_size=5))
def test_the_mean_rotation_is_the_centre_of_symmetric_perturbations(
    centre: FloatArray, perturbations: list[tuple[FloatArray, float]]
) -> None:
    around = [centre @ axis_rotation(axis, sign * angle) for axis, angle in perturbations for sign in (1.0, -1.0)]
    assert float(rotation_angle(mean_rotation(np.array(around)), centre)) < 1e-7


@given(rotations, rotations, st.integers(0, 1000))
def test_the_mean_rotation_turns_with_the_rotations(centre: FloatArray, turn: FloatArray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    around = np.array([axis_rotation(unit(rng.normal(size=3)), rng.uniform(0.0, 1.0)) @ centre for _ in range(6)])
    mean = mean_rotation(around)
    np.testing.assert_allclose(mean_rotation(turn @ around), turn @ mean, atol=1e-9)
    np.testing.assert_allclose(mean_rotation(around @ turn), mean @ turn, atol=1e-9)


def test_the_mean_rotation_takes_any_axis() -> None:
    rng = np.random.default_rng(5)
    many = np.array([[random_rotation(rng) for _ in range(4)] for _ in range(3)])
    np.testing.assert_allclose(mean_rotation(many, axis=1)[2], mean_rotation(many[2]), atol=EXACT)


@given(directions, directions)
def test_the_tangent_leads_to_the_end(start: FloatArray, end: FloatArray) -> None:
    angle = float(angle_between(start, end))
    tangent = tangent_towards(start, end)
    if 1e-6 < angle < np.pi - 1e-6:
        assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=EXACT)
        assert float(tangent @ start) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(move_along(start, tangent, angle), end, atol=1e-9)


@given(directions)
def test_there_is_no_tangent_to_the_same_or_the_opposite_point(start: FloatArray) -> None:
    assert not tangent_towards(start, start).any()
    assert not tangent_towards(start, -start).any()


@given(directions, directions, st.floats(np.radians(2.0), 2.0))
def test_a_great_circle_goes_straight_to_its_end_in_bounded_steps(
    start: FloatArray, end: FloatArray, step_rad: float
) -> None:
    points = great_circle(start, end, step_rad)
    np.testing.assert_array_equal(points[-1], end)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=EXACT)
    steps = angle_between(np.vstack([start, points[:-1]]), points)
    assert steps.max() <= step_rad + 1e-8
    assert steps.sum() == pytest.approx(float(angle_between(start, end)), abs=1e-8)  # none shorter: all on one arc
    assert np.ptp(steps) < 1e-8


@given(directions, st.floats(np.radians(2.0), 2.0))
def test_a_great_circle_to_the_same_point_is_that_point(start: FloatArray, step_rad: float) -> None:
    np.testing.assert_array_equal(great_circle(start, start, step_rad), start[None])


@given(directions, st.floats(np.radians(2.0), 2.0))
def test_a_great_circle_to_the_opposite_point_is_half_a_circle_in_one_plane(start: FloatArray, step_rad: float) -> None:
    points = great_circle(start, -start, step_rad)
    steps = angle_between(np.vstack([start, points[:-1]]), points)
    assert steps.max() <= step_rad + 1e-9
    assert steps.sum() == pytest.approx(np.pi)
    assert np.linalg.svd(np.vstack([start, points]), compute_uv=False)[2:].sum() == pytest.approx(0.0, abs=1e-9)


@given(directions)
def test_perpendicular_is_perpendicular_and_always_the_same(direction: FloatArray) -> None:
    side = perpendicular(direction)
    assert np.linalg.norm(side) == pytest.approx(1.0, abs=EXACT)
    assert float(side @ direction) == pytest.approx(0.0, abs=EXACT)
    np.testing.assert_array_equal(side, perpendicular(direction.copy()))


@pytest.mark.parametrize("count", [4, 100, 2000])
def test_a_fibonacci_sphere_covers_the_sphere(count: int) -> None:
    points = fibonacci_sphere(count)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=EXACT)
    rng = np.random.default_rng(0)
    anywhere = unit(rng.normal(size=(500, 3)))
    gap = angle_between(anywhere[:, None], points[None]).min(axis=1)
    assert gap.max() < 2.5 * np.sqrt(4.0 / count)  # a cap of that area per point, and some


def test_a_hundred_views_are_as_far_apart_as_the_seeds() -> None:
    points = equidistant_sphere(100)
    edges = delaunay_edges(points)
    length_deg = np.degrees(angle_between(points[edges[:, 0]], points[edges[:, 1]]))
    assert length_deg.mean() == pytest.approx(22.6, abs=1.0)
    nearest = np.degrees(np.sort(angle_between(points[:, None], points[None]), axis=1)[:, 1])
    assert nearest.min() > 18.0
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=EXACT)


@pytest.mark.parametrize("count", [4, 12, 100, 250])
def test_delaunay_edges_triangulate_the_whole_sphere(count: int) -> None:
    edges = delaunay_edges(fibonacci_sphere(count))
    assert edges.dtype == np.int32
    assert len(edges) == 3 * count - 6  # Euler
    assert (edges[:, 0] < edges[:, 1]).all()
    assert len({tuple(edge) for edge in edges.tolist()}) == len(edges)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1


@given(directions, directions, angles)
def test_the_rotation_shows_the_view_at_any_roll(view: FloatArray, camera: FloatArray, roll: float) -> None:
    rotation = rotation_showing(view, camera, roll)
    assert_rotation(rotation)
    np.testing.assert_allclose(rotation.T @ camera, view, atol=EXACT)
    np.testing.assert_allclose(rotation, axis_rotation(camera, roll) @ rotation_showing(view, camera), atol=EXACT)
