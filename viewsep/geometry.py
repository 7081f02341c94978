"""Unit vectors, rotations and the view sphere.

Rotations are (3, 3) float64 matrices unless a name says otherwise; view directions are (..., 3) unit vectors.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from viewsep.messages import Array, FloatArray

GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))
GAP = 1.6  # a step this much longer than the usual one leaves something out
WIDEST_CAP_RAD = np.radians(30.0)  # between views much closer than that, a wider cap is a hole
WIDEST_EDGE_RAD = np.radians(100.0)  # views from opposite sides share nothing
ON_RING = 0.2  # views this close to one circle, as a share of the step along it, make a ring


def unit(vectors: FloatArray) -> FloatArray:
    """(..., 3) vectors scaled to length 1; a zero vector stays zero."""
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: FloatArray = np.divide(vectors, norm, out=np.zeros_like(vectors), where=norm > 0)
    return scaled


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle in radians between unit vectors (..., 3) and (..., 3), exact near 0 and pi too."""
    angle: FloatArray = 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angle


def spherical_direction(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Unit vector (cos el cos az, cos el sin az, sin el) (design section 6). Elevations beyond a pole go over it."""
    c = np.cos(elevation_rad)
    return np.array([c * np.cos(azimuth_rad), c * np.sin(azimuth_rad), np.sin(elevation_rad)])


def azimuth_elevation(direction: FloatArray) -> tuple[float, float]:
    """Azimuth in (-pi, pi] and elevation in [-pi/2, pi/2] of a (3,) unit vector."""
    x, y, z = direction
    return float(np.arctan2(y, x)), float(np.arctan2(z, np.hypot(x, y)))


def axis_rotation(axis: FloatArray, angle_rad: float) -> FloatArray:
    """(3, 3) rotation by `angle_rad` about the unit vector `axis` (Rodrigues)."""
    cross = cross_matrix(axis)
    rotation: FloatArray = np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * (cross @ cross)
    return rotation


def cross_matrix(vector: FloatArray) -> FloatArray:
    """The (3, 3) matrix K of a (3,) vector with K v = vector x v."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """A rotation drawn uniformly over SO(3)."""
    return quaternion_to_matrix(unit(rng.normal(size=4)))


def quaternion_to_matrix(xyzw: FloatArray) -> FloatArray:
    """(4,) unit quaternion x, y, z, w -> (3, 3)."""
    matrix: FloatArray = Rotation.from_quat(xyzw).as_matrix()
    return matrix


def matrix_to_quaternion(matrix: FloatArray) -> FloatArray:
    """(3, 3) -> (4,) unit quaternion x, y, z, w with w >= 0."""
    xyzw: FloatArray = Rotation.from_matrix(matrix).as_quat(canonical=True)
    return xyzw


def rotation_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle in radians of the rotation from (..., 3, 3) to (..., 3, 3)."""
    # the chord ||a - b|| = 2 sqrt(2) sin(angle / 2) stays exact for small angles, unlike the trace
    chord = np.linalg.norm(a - b, axis=(-2, -1))
    angle: FloatArray = 2.0 * np.arcsin(np.clip(chord / (2.0 * np.sqrt(2.0)), 0.0, 1.0))
    return angle


def nearest_rotation(matrices: FloatArray) -> FloatArray:
    """The rotations nearest to (..., 3, 3) matrices: argmax over R of trace(Rᵀ M) (Wahba's problem by SVD)."""
    u, _, vt = np.linalg.svd(matrices)
    u = u.copy()
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    nearest: FloatArray = u @ vt
    return nearest


def mean_rotation(rotations: FloatArray, axis: int = 0) -> FloatArray:
    """Chordal mean of rotations (..., 3, 3) over one axis."""
    return nearest_rotation(rotations.mean(axis=axis))


def tangent_towards(start: FloatArray, end: FloatArray) -> FloatArray:
    """Unit tangents (..., 3) at `start` of the arc to `end`; zero where the two coincide or are opposite."""
    tangent = end - np.sum(start * end, axis=-1, keepdims=True) * start
    norm = np.linalg.norm(tangent, axis=-1, keepdims=True)
    scaled: FloatArray = np.divide(tangent, norm, out=np.zeros_like(tangent), where=norm > 1e-9)
    return scaled


def move_along(start: FloatArray, tangent: FloatArray, angle_rad: float) -> FloatArray:
    """The (3,) point `angle_rad` away from `start` along the great circle with unit `tangent`."""
    return unit(np.cos(angle_rad) * start + np.sin(angle_rad) * tangent)


def great_circle(start: FloatArray, end: FloatArray, step_rad: float) -> FloatArray:
    """(N, 3) points after `start` up to and with `end` on the shortest arc, at most `step_rad` apart."""
    angle = float(angle_between(start, end))
    count = max(1, int(np.ceil(angle / step_rad - 1e-9)))
    tangent = tangent_towards(start, end)
    if not tangent.any():  # the same point, or opposite ones: any great circle is a shortest one
        tangent = perpendicular(start)
    turned = (angle * np.arange(1, count) / count)[:, None]
    return np.vstack([unit(np.cos(turned) * start + np.sin(turned) * tangent), end])


def perpendicular(direction: FloatArray) -> FloatArray:
    """A (3,) unit vector perpendicular to `direction`, the same one every time."""
    other = np.zeros(3)
    other[int(np.argmin(np.abs(direction)))] = 1.0
    return unit(np.cross(direction, other))


def nearest_points(points: FloatArray, queries: FloatArray) -> tuple[FloatArray, Array]:
    """For each query (Q, 3) the distance (Q,) to the closest of the points (P, 3), and its index (Q,)."""
    gap, index = cKDTree(points).query(queries)
    return np.asarray(gap), np.asarray(index)


def fibonacci_sphere(count: int) -> FloatArray:
    """(count, 3) nearly equidistant unit vectors on a Fibonacci spiral."""
    i = np.arange(count)
    z = 1.0 - (2.0 * i + 1.0) / count
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(GOLDEN_ANGLE_RAD * i), r * np.sin(GOLDEN_ANGLE_RAD * i), z], axis=1)


def spacing_of(directions: FloatArray) -> float:
    """Median angle in radians from each of the directions (N, 3), N > 1, to the one closest to it."""
    chords = np.asarray(cKDTree(directions).query(directions, k=2)[0])[:, 1]
    return float(np.median(2.0 * np.arcsin(np.minimum(chords / 2.0, 1.0))))


def equidistant_sphere(count: int, iterations: int = 300) -> FloatArray:
    """(count, 3) equidistant unit vectors: a Fibonacci spiral relaxed as charges that repel each other.

    The seed samples its 100 views "at equidistant positions" (section III.A); mean neighbour angle there: 22.6°.
    """
    points = fibonacci_sphere(count)
    step = 0.1 / count
    for _ in range(iterations):
        difference = points[:, None] - points[None]
        squared = np.sum(difference**2, axis=-1)
        np.fill_diagonal(squared, np.inf)
        force = np.sum(difference / squared[..., None] ** 1.5, axis=1)
        force -= np.sum(force * points, axis=1, keepdims=True) * points
        points = unit(points + step / np.sqrt(count) * force)
    return points


def delaunay_edges(directions: FloatArray) -> Array:
    """(E, 2) int32 sorted node pairs of the Delaunay triangulation on the sphere, which is the convex hull."""
    faces = ConvexHull(directions).simplices
    return _sorted_pairs(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))


def view_edges(directions: FloatArray, gap: float = GAP) -> Array:
    """(E, 2) int32 sorted pairs of neighbours among views (N, 3) that cover any part of the sphere.

    On whole spheres of a dozen views or more these are the `delaunay_edges`. Views on a ring are neighbours of the next
    ones along it. No edge bridges what was not covered: a step along a ring of more than `gap` times the median step,
    or a facet of the hull whose circumscribed cap has room for a missing view (alpha shape). Views more than 100
    degrees apart are no neighbours, and fewer than three views have none.
    """
    if len(directions) < 3:
        return np.empty((0, 2), np.int32)
    along = _along_ring(directions, gap)
    edges = _alpha_edges(directions, gap) if along is None else along
    together = np.einsum("ei,ei->e", directions[edges[:, 0]], directions[edges[:, 1]]) > np.cos(WIDEST_EDGE_RAD)
    near: Array = edges[together]
    return near


def _along_ring(directions: FloatArray, gap: float) -> Array | None:
    """Edges between consecutive views (N, 3) of a ring, or None where they do not lie on one circle."""
    axis = np.linalg.svd(directions - directions.mean(axis=0), full_matrices=False)[2][2]
    side = perpendicular(axis)
    around = np.arctan2(directions @ np.cross(axis, side), directions @ side)
    order = np.argsort(around, kind="stable")
    steps = np.diff(around[order], append=around[order[0]] + 2.0 * np.pi)
    polar = np.arccos(np.clip(directions @ axis, -1.0, 1.0))
    middle = float(np.median(polar))
    if np.abs(polar - middle).max() > ON_RING * np.median(steps) * np.sin(middle):
        return None
    kept = steps <= gap * np.median(steps)
    return _sorted_pairs(np.stack([order, np.roll(order, -1)], axis=1)[kept])


def _alpha_edges(directions: FloatArray, gap: float) -> Array:
    """Edges of the hull's facets without holes, and short edges with nothing between their ends (Gabriel)."""
    hull = ConvexHull(directions)
    caps = np.arccos(np.clip(-hull.equations[:, 3], -1.0, 1.0))
    smallest = np.full(len(directions), np.inf)
    np.minimum.at(smallest, hull.simplices.ravel(), np.repeat(caps, 3))
    spacing = spacing_of(directions)
    # in equidistant views caps measure 0.6 to 0.85 of the spacing, and 1 where one view is missing; where the spacing
    # differs by direction, as on grids of azimuth and elevation, only caps can be compared with each other
    usual = min(float(np.median(smallest)), WIDEST_CAP_RAD)
    largest = gap / GAP * max(0.93 * spacing, 1.3 * usual)
    corners = hull.simplices[caps <= largest]
    kept = _sorted_pairs(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]))
    pairs = delaunay_edges(directions)
    middles = unit(directions[pairs].sum(axis=1))
    half = 0.5 * angle_between(directions[pairs[:, 0]], directions[pairs[:, 1]])
    empty = nearest_points(directions, middles)[0] > 2.0 * np.sin(half / 2.0) - 1e-9
    return _sorted_pairs(np.concatenate([kept, pairs[empty & (half <= 0.5 * gap * spacing)]]))


def _sorted_pairs(pairs: Array) -> Array:
    """(E, 2) int32: each pair once, smaller index first, in order."""
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)


def rotation_showing(view_direction: FloatArray, camera_direction: FloatArray, roll_rad: float = 0.0) -> FloatArray:
    """A rotation (3, 3) of the object after which a camera in `camera_direction` sees it from `view_direction`."""
    side, camera_side = perpendicular(view_direction), perpendicular(camera_direction)
    of_view = np.stack([view_direction, side, np.cross(view_direction, side)], axis=1)
    of_camera = np.stack([camera_direction, camera_side, np.cross(camera_direction, camera_side)], axis=1)
    return axis_rotation(camera_direction, roll_rad) @ of_camera @ of_view.T
