"""The views a rig can show, and how to get from one to another."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from viewsep.geometry import angle_between, great_circle, spacing_of, tangent_towards, view_edges
from viewsep.kinematics import VIEW_TOLERANCE_RAD, RigGeometry, reachable_directions
from viewsep.messages import Array, BoolArray, FloatArray

WIDEST_STEP = 3.2  # from one recorded view to the next, times the usual step: beyond it lies a gap, which is its edge


class ReachableViews:
    """Reachable view directions in the control frame.

    `directions` (M, 3) cover what can be reached; `reaches(c)` says which of (..., 3) can be shown exactly: (...) bool.
    `single` is True where nothing but `directions` can be reached, however far apart they are.
    """

    def __init__(
        self, directions: FloatArray, reaches: Callable[[FloatArray], BoolArray], *, single: bool = False
    ) -> None:
        self.directions = directions
        self.reaches = reaches
        self.single = single
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
        return ReachableViews(reachable_directions(geometry), geometry.reaches)

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

    def _shortest(self, start: FloatArray, end: FloatArray) -> Array:
        """Indices of the directions on the shortest way from `start` to `end`, empty where there is none."""
        first, last = (int(self._tree.query(point)[1]) for point in (start, end))
        _, (before,) = dijkstra(self._graph, directed=False, indices=[first], return_predecessors=True)
        way = [last]
        while way[-1] != first:
            previous = int(before[way[-1]])
            if previous < 0:
                return np.empty(0, int)
            way.append(previous)
        return np.array(way[::-1])

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
