"""The views a rig can show, and how to get from one to another."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from viewsep.geometry import angle_between, great_circle, perpendicular, spacing_of, tangent_towards, view_edges
from viewsep.kinematics import VIEW_TOLERANCE_RAD, RigGeometry, reachable_directions
from viewsep.messages import Array, BoolArray, FloatArray

SIDE_RAD = np.radians(60.0)  # from a view: what faces it that much shows what is on it
WIDEST_STEP = 3.2  # from one recorded view to the next, times the usual step: beyond it lies a gap, which is its edge


class ReachableViews:
    """Reachable view directions in the control frame.

    `directions` (M, 3) cover what can be reached; `reaches(c)` says which of (..., 3) can be shown exactly: (...) bool.
    `single` is True where nothing but `directions` can be reached, however far apart they are. `speed_rad_s` is how
    fast the slowest joint turns, and so the view at least.
    """

    def __init__(
        self,
        directions: FloatArray,
        reaches: Callable[[FloatArray], BoolArray],
        *,
        single: bool = False,
        speed_rad_s: float = 1.0,
    ) -> None:
        self.directions = directions
        self.reaches = reaches
        self.single = single
        self.speed_rad_s = speed_rad_s
        self.spacing_rad = spacing_of(directions)
        self._tree = cKDTree(directions)

    @staticmethod
    def only(directions: FloatArray) -> ReachableViews:
        """These views (M, 3), M > 1, and nothing between them: those of recorded photos."""
        tree = cKDTree(directions)
        return ReachableViews(
            directions, lambda views: np.asarray(tree.query(views)[0] < VIEW_TOLERANCE_RAD), single=True
        )

    @staticmethod
    @lru_cache(maxsize=8)
    def of(geometry: RigGeometry) -> ReachableViews:
        """All views of a rig with revolute joints."""
        speed = min(limit.max_speed_rad_s for limit in geometry.limits)
        return ReachableViews(reachable_directions(geometry), geometry.reaches, speed_rad_s=speed)

    def unseen(self, seen: FloatArray) -> FloatArray:
        """(U, 3) those of `directions` that lie on sides which looks from the views `seen` (L, 3) did not show."""
        return np.asarray(self.directions[~shows(seen, self.directions).any(axis=0)])

    def nearest(self, directions: FloatArray) -> FloatArray:
        """Those of (..., 3) directions that can be reached themselves, for others the closest of `self.directions`."""
        closest = self.directions[self._tree.query(directions)[1]]
        return np.where(self.reaches(directions)[..., None], directions, closest)

    def onward(self, view: FloatArray, heading: FloatArray) -> FloatArray:
        """Of the views next to `view` (3,) the one whose direction differs least from the unit tangent `heading`.

        Where nothing lies next to it, of all other views.
        """
        here = int(self._tree.query(view)[1])
        near = np.concatenate([self._pairs[self._pairs[:, k] == here, 1 - k] for k in (0, 1)])
        if len(near) == 0:
            near = np.delete(np.arange(len(self.directions)), here)
        ahead = tangent_towards(view, self.directions[near]) @ heading
        next_one: FloatArray = self.directions[int(near[int(np.argmax(ahead))])]
        return next_one

    def path(self, start: FloatArray, end: FloatArray, step_rad: float) -> FloatArray:
        """(N, 3) waypoints after `start` up to and with the reachable `end`, about `step_rad` apart.

        The great circle (section IV.E) where all of it can be reached, otherwise the shortest way through reachable
        views; `end` alone where the reachable views fall apart.
        """
        arc = great_circle(start, end, step_rad)
        if self.reaches(arc).all():
            return arc
        inner = self.directions[self._shortest(start, end)]
        waypoints: list[FloatArray] = []
        here = start
        for point in inner:
            if angle_between(here, point) >= step_rad:
                waypoints.append(point)
                here = point
        if waypoints and angle_between(waypoints[-1], end) < 0.5 * step_rad:
            waypoints.pop()
        return np.array([*waypoints, end])

    def ways(self, start: FloatArray, ends: FloatArray, step_rad: float) -> tuple[Array, BoolArray, FloatArray]:
        """About how the views lie on the ways from `start` (3,) to many reachable `ends` (V, 3), to compare them.

        Returns (V, N) indices of directions about `step_rad` apart, the end last, (V, N) which of them there are, and
        (V,) lengths in radians. What `path` goes exactly is here only as near as the next direction; an end that cannot
        be reached has an infinite length.
        """
        points, there, length = _arcs(start, ends, step_rad)
        gap, node = np.zeros(there.shape), np.zeros(there.shape, int)
        gap[there], node[there] = self._tree.query(points[there])
        passable = np.all(gap <= self._reach, axis=1)
        if passable.all():
            return node, there, length
        first, *last = np.asarray(self._tree.query(np.vstack([start, ends]))[1]).tolist()
        along, before = dijkstra(self._graph, directed=False, indices=[first], return_predecessors=True)
        ways = {v: self._thinned(_back(before.ravel(), first, last[v]), step_rad) for v in np.flatnonzero(~passable)}
        more = max(len(way) for way in ways.values()) - there.shape[1]
        if more > 0:
            node, there = (np.pad(part, ((0, 0), (0, more))) for part in (node, there))
        for v, way in ways.items():
            length[v] = along.ravel()[last[v]]
            node[v, : len(way)] = way
            there[v] = np.arange(there.shape[1]) < len(way)
        return node, there, length

    def _thinned(self, nodes: Array, step_rad: float) -> Array:
        """Those of the nodes on a way that are `step_rad` apart, the last one always."""
        if len(nodes) < 2:
            return nodes
        done = np.cumsum(angle_between(self.directions[nodes[1:]], self.directions[nodes[:-1]]))
        steps = np.floor(done / step_rad + 1e-9)
        return np.append(nodes[1:-1][np.diff(steps) > 0], nodes[-1])

    @cached_property
    def _reach(self) -> float:
        """How far a view may be from the nearest direction to be on the way."""
        return VIEW_TOLERANCE_RAD if self.single else 1.3 * self.spacing_rad

    def _shortest(self, start: FloatArray, end: FloatArray) -> Array:
        """Indices of the directions on the shortest way from `start` to `end`, empty where there is none."""
        first, last = (int(self._tree.query(point)[1]) for point in (start, end))
        _, (before,) = dijkstra(self._graph, directed=False, indices=[first], return_predecessors=True)
        return _back(before, first, last)

    @cached_property
    def _pairs(self) -> Array:
        """(E, 2) indices of directions that lie next to each other."""
        if self.single:
            return view_edges(self.directions, WIDEST_STEP)
        gaps = np.asarray(self._tree.query(self.directions, k=2)[0])[:, 1]
        return self._tree.query_pairs(2.2 * float(np.median(gaps)), output_type="ndarray")

    @cached_property
    def _graph(self) -> csr_matrix[np.float64]:
        """Angles between directions that lie next to each other."""
        pairs = self._pairs
        length = angle_between(self.directions[pairs[:, 0]], self.directions[pairs[:, 1]])
        return csr_matrix((length, (pairs[:, 0], pairs[:, 1])), shape=(len(self.directions),) * 2)


def shows(views: FloatArray, sides: FloatArray) -> BoolArray:
    """(V, U) whether a look from each of (V, 3) views shows what faces each of the directions (U, 3)."""
    return np.asarray(views @ sides.T > np.cos(SIDE_RAD))


def _back(before: Array, first: int, last: int) -> Array:
    """The nodes from `first` to `last` by their predecessors, empty where there is no way."""
    way = [last]
    while way[-1] != first:
        previous = int(before[way[-1]])
        if previous < 0:
            return np.empty(0, int)
        way.append(previous)
    return np.array(way[::-1])


def _arcs(start: FloatArray, ends: FloatArray, step_rad: float) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Points (V, N, 3) `step_rad` apart on the great circles to (V, 3), the end last, which there are, and lengths."""
    length = angle_between(np.broadcast_to(start, ends.shape), ends)
    count = np.maximum(1, np.ceil(length / step_rad - 1e-9)).astype(int)
    index = np.arange(1, int(count.max()) + 1)
    angle = np.minimum(index * step_rad, length[:, None])[..., None]
    tangent = tangent_towards(start, ends)
    nowhere = ~tangent.any(axis=1)
    if nowhere.any():  # the same point, or the opposite one
        tangent[nowhere] = perpendicular(start)
    points = np.cos(angle) * start + np.sin(angle) * tangent[:, None]
    return points, index <= count[:, None], length
