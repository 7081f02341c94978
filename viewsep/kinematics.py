"""Rigs as revolute axes through the object's centre (design section 3).

`c(q) = (Rot(axis_1, q_1) · … · Rot(axis_n, q_n))ᵀ · camera_dir`: the first axis is fixed to the world, the last one
holds the object. The control frame is the frame of the last link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from viewsep.errors import BadConfig, MoveRefused, UnreachableView
from viewsep.geometry import (
    angle_between,
    axis_rotation,
    cross_matrix,
    fibonacci_sphere,
    nearest_points,
    spherical_direction,
    unit,
)
from viewsep.interfaces import JointLimits
from viewsep.messages import BoolArray, FloatArray

VIEW_TOLERANCE_RAD = np.radians(0.05)
GRID_STEP_DEG = {1: 2.0, 2: 3.0, 3: 9.0}  # by number of joints


@dataclass(frozen=True, eq=False)
class RigGeometry:
    """Axes (n, 3) in the world frame at q = 0, joint limits, and the (3,) direction from the object to the camera."""

    name: str
    axes: FloatArray
    limits: tuple[JointLimits, ...]
    camera_direction: FloatArray

    def holder_rotation(self, position_rad: Sequence[float]) -> FloatArray:
        """(3, 3) rotation control frame -> world for joint angles (n,)."""
        rotation = np.eye(3)
        for axis, angle in zip(self.axes, position_rad, strict=True):
            rotation = rotation @ axis_rotation(axis, angle)
        return rotation

    def view_direction(self, position_rad: Sequence[float]) -> FloatArray:
        """The (3,) view direction c(q) in the control frame."""
        direction: FloatArray = self.holder_rotation(position_rad).T @ self.camera_direction
        return direction

    def view_directions(self, positions_rad: FloatArray) -> FloatArray:
        """(P, n) joint angles -> (P, 3) view directions."""
        views = np.broadcast_to(self.camera_direction, (len(positions_rad), 3))
        for cross, angle in zip(self._crosses, positions_rad.T, strict=True):
            views = _rotate_back(views, cross, angle)
        return views

    @cached_property
    def _crosses(self) -> list[FloatArray]:
        """The axes' cross product matrices."""
        return [cross_matrix(axis) for axis in self.axes]

    def _views_and_jacobian(self, positions_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P, n) joint angles -> views (P, 3) and their derivatives (P, 3, n) by the joint angles."""
        views = np.broadcast_to(self.camera_direction, (len(positions_rad), 3))
        jacobian = np.zeros((len(positions_rad), 3, len(self.axes)))
        for joint, (cross, angle) in enumerate(zip(self._crosses, positions_rad.T, strict=True)):
            views = _rotate_back(views, cross, angle)
            for earlier in range(joint):
                jacobian[:, :, earlier] = _rotate_back(jacobian[:, :, earlier], cross, angle)
            jacobian[:, :, joint] = views @ cross
        return views, jacobian

    def grid_views(self) -> FloatArray:
        """(G, 3) views that a grid over the joint space shows."""
        return self._grid[1]

    def within_limits(self, positions_rad: FloatArray) -> BoolArray:
        """(P, n) -> (P,) bool, with a nanoradian's grace for rounding."""
        lower, upper = self._bounds()
        inside = (positions_rad >= lower - 1e-9) & (positions_rad <= upper + 1e-9)
        return np.asarray(inside.all(axis=1))

    def joints_for(self, view_direction: FloatArray, near_rad: Sequence[float]) -> tuple[float, ...]:
        """Joint angles within the limits that show a view, the closest to `near_rad` found.

        Damped least squares from `near_rad`, and where that fails from a grid over the joint space. Raises
        UnreachableView.
        """
        near = np.asarray(near_rad, float)
        reachable = self._solutions(near[None], view_direction, near)
        if len(reachable) == 0:
            reachable = self._solutions(self._starts(view_direction, near), view_direction, near)
        if len(reachable) == 0:
            x, y, z = view_direction
            raise UnreachableView(
                f"rig {self.name!r} cannot show the view ({x:.3f}, {y:.3f}, {z:.3f}) within its joint limits"
            )
        effort = np.abs(reachable - near).max(axis=1)
        return tuple(float(q) for q in reachable[int(np.argmin(effort))])

    def reaches(self, view_directions: FloatArray) -> BoolArray:
        """(..., 3) view directions -> (...) bool: whether joint angles within the limits show them.

        Solved together from the closest views of a grid over the joint space; where that fails, from more of them.
        """
        wanted = view_directions.reshape(-1, 3)
        home = np.array(self.home())
        starts = self._grid[0][self._grid_tree.query(wanted)[1]]
        solved = self._solve(starts, wanted, within_rad=0.1 * VIEW_TOLERANCE_RAD)
        shown = self._shows(self._nearest_turns(solved, home), wanted)
        for missed in np.flatnonzero(~shown):
            shown[missed] = len(self._solutions(self._starts(wanted[missed], home), wanted[missed], home)) > 0
        return shown.reshape(view_directions.shape[:-1])

    def home(self, near_rad: Sequence[float] | None = None) -> tuple[float, ...]:
        """Joint angles of zero, or of the limit nearest to it; of free joints the whole turn nearest to `near_rad`."""
        at_zero = (min(max(0.0, limit.lower_rad), limit.upper_rad) for limit in self.limits)
        if near_rad is None:
            return tuple(at_zero)
        turn = 2 * np.pi
        return tuple(
            float(turn * np.round(near / turn)) if np.isinf([limit.lower_rad, limit.upper_rad]).all() else home
            for home, near, limit in zip(at_zero, near_rad, self.limits, strict=True)
        )

    def _solutions(self, starts: FloatArray, view_direction: FloatArray, near: FloatArray) -> FloatArray:
        """Those of (S, n) starts that lead to the view within the limits, as (G, n) joint angles close to `near`."""
        solved = self._nearest_turns(self._solve(starts, view_direction), near)
        found: FloatArray = solved[self._shows(solved, view_direction)]
        return found

    def _shows(self, positions_rad: FloatArray, view_directions: FloatArray) -> BoolArray:
        """(P,) bool: whether joint angles (P, n) are within the limits and show the view, (3,) or one each (P, 3)."""
        miss = angle_between(self.view_directions(positions_rad), view_directions)
        return np.asarray(self.within_limits(positions_rad) & (miss < VIEW_TOLERANCE_RAD))

    @cached_property
    def _grid(self) -> tuple[FloatArray, FloatArray]:
        """Joint angles (G, n) over the whole joint space, free joints over one turn, and the views (G, 3) they show."""
        step = np.radians(GRID_STEP_DEG[min(len(self.axes), 3)])
        ranges = [
            np.linspace(low, high, int(np.ceil((high - low) / step)) + 1)
            for low, high in (one_turn(limit) for limit in self.limits)
        ]
        grid = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(ranges))
        return grid, self.view_directions(grid)

    @cached_property
    def _grid_tree(self) -> cKDTree:
        return cKDTree(self._grid[1])

    def _starts(self, view_direction: FloatArray, near: FloatArray) -> FloatArray:
        """(S, n) grid points to start solving from: those that come closest to the view, and close ones near `near`."""
        grid, views = self._grid
        miss = angle_between(views, view_direction)
        close = np.argsort(miss, kind="stable")[:200]
        by_effort = close[np.argsort(np.abs(grid[close] - near).max(axis=1), kind="stable")]
        starts: FloatArray = grid[np.concatenate([close[:12], by_effort[:24]])]
        return starts

    def _solve(
        self, starts: FloatArray, view_directions: FloatArray, iterations: int = 40, within_rad: float = 1e-9
    ) -> FloatArray:
        """Levenberg-Marquardt with fixed damping on (S, n) joint angles, clipped to the limits at every step.

        One view (3,) for all starts, or one for each (S, 3); it ends when all are `within_rad` of theirs.
        """
        lower, upper = self._bounds()
        damping = 1e-4 * np.eye(len(self.axes))
        q = np.clip(starts, lower, upper)
        for _ in range(iterations):
            views, jacobian = self._views_and_jacobian(q)
            miss = view_directions - views
            if np.abs(miss).max() < within_rad:
                break
            transposed = jacobian.swapaxes(1, 2)
            step = np.linalg.solve(transposed @ jacobian + damping, transposed @ miss[..., None])
            q = np.clip(q + step[..., 0], lower, upper)
        return q

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper joint limits, (n,) each."""
        return (
            np.array([limit.lower_rad for limit in self.limits]),
            np.array([limit.upper_rad for limit in self.limits]),
        )

    def _nearest_turns(self, positions_rad: FloatArray, near: FloatArray) -> FloatArray:
        """Whole turns added to joints where the limits allow, to come closest to `near`."""
        turned = positions_rad + 2 * np.pi * np.round((near - positions_rad) / (2 * np.pi))
        lower, upper = self._bounds()
        return np.where((turned >= lower) & (turned <= upper), turned, positions_rad)


def check_setpoints(position_rad: Sequence[float], limits: Sequence[JointLimits]) -> None:
    """Set-points (n,) of a move must be within the joints' limits. Raises MoveRefused naming joint, value and range."""
    if len(position_rad) != len(limits):
        raise MoveRefused(f"the rig has {len(limits)} joints, but {len(position_rad)} set-points were given")
    for q, limit in zip(position_rad, limits, strict=True):
        if not (np.isfinite(q) and limit.lower_rad - 1e-6 <= q <= limit.upper_rad + 1e-6):
            raise MoveRefused(
                f"joint {limit.name!r}: set-point {np.degrees(q):.2f} deg is outside "
                f"[{np.degrees(limit.lower_rad):g}, {np.degrees(limit.upper_rad):g}] deg"
            )


def one_turn(limit: JointLimits) -> tuple[float, float]:
    """The range of a joint in radians, cut to one turn around zero, or around the limit nearest to zero."""
    middle = min(max(0.0, limit.lower_rad), limit.upper_rad)
    return max(limit.lower_rad, middle - np.pi), min(limit.upper_rad, middle + np.pi)


def _rotate_back(directions: FloatArray, cross: FloatArray, angle: FloatArray) -> FloatArray:
    """Rot(axis, angle)ᵀ applied to (P, 3) with angles (P,) and the axis' cross product matrix (Rodrigues)."""
    sine, versine = np.sin(angle)[:, None], 1.0 - np.cos(angle)[:, None]
    turned = directions @ cross
    rotated: FloatArray = directions + sine * turned + versine * (turned @ cross)
    return rotated


def rig_geometry(
    name: str, axes: Sequence[Sequence[float]], limits: Sequence[JointLimits], camera_elevation_deg: float
) -> RigGeometry:
    """A rig from axes (any length, not zero) and a camera at azimuth 0. Raises BadConfig."""
    array = np.asarray(axes, float).reshape(-1, 3)
    if len(array) != len(limits):
        raise BadConfig(
            f"rig {name!r} has {len(array)} axes but {len(limits)} joint limits: give one of each per joint"
        )
    for axis, limit in zip(array, limits, strict=True):
        if not np.isfinite(axis).all() or not axis.any():
            raise BadConfig(
                f"rig {name!r}, joint {limit.name!r}: axis {axis.tolist()} has no direction; use e.g. [0, 0, 1]"
            )
        if not limit.lower_rad < limit.upper_rad:
            raise BadConfig(
                f"rig {name!r}, joint {limit.name!r}: lower limit {np.degrees(limit.lower_rad):g} deg is not below the "
                f"upper limit {np.degrees(limit.upper_rad):g} deg"
            )
    camera = spherical_direction(0.0, np.radians(camera_elevation_deg))
    return RigGeometry(name, unit(array), tuple(limits), camera)


def preset(name: str, camera_elevation_deg: float | None = None) -> RigGeometry:
    """The rigs of design section 3: turntable, pan_tilt, wrist, gimbal. Raises BadConfig for another name."""
    if name not in PRESETS:
        raise BadConfig(f"unknown rig preset {name!r}: choose one of {', '.join(PRESETS)}")
    axes, joints, elevation = PRESETS[name]
    limits = [
        JointLimits(joint, np.radians(lower), np.radians(upper), np.radians(PRESET_SPEED_DEG_S))
        for joint, lower, upper in joints
    ]
    return rig_geometry(name, axes, limits, elevation if camera_elevation_deg is None else camera_elevation_deg)


_FREE = np.inf
PRESET_SPEED_DEG_S = 20.0  # at the four looks per second of the interpretation module, 5° lie between looks
PRESETS: dict[str, tuple[list[list[float]], list[tuple[str, float, float]], float]] = {
    # name: axes, (joint, lower deg, upper deg), camera elevation deg
    "turntable": ([[0, 0, 1]], [("pan", -_FREE, _FREE)], 25.0),
    "pan_tilt": ([[0, 1, 0], [0, 0, 1]], [("tilt", -60.0, 60.0), ("pan", -_FREE, _FREE)], 20.0),
    "wrist": (
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [("roll", -60.0, 60.0), ("pitch", -75.0, 75.0), ("yaw", -170.0, 170.0)],
        15.0,
    ),
    "gimbal": ([[0, 1, 0], [0, 0, 1]], [("tilt", -100.0, 100.0), ("pan", -_FREE, _FREE)], 0.0),
}


def reachable_directions(geometry: RigGeometry, count: int = 2000) -> FloatArray:
    """(M, 3) directions that cover the rig's reachable views about evenly: 4.5° apart for the whole sphere.

    With one joint they lie on its ring, 2° apart; with more they are nearly those of a Fibonacci sphere.
    """
    if len(geometry.limits) == 1:
        limit = geometry.limits[0]
        lower, upper = one_turn(limit)
        steps = int(np.ceil((upper - lower) / np.radians(2.0)))
        full_turn = upper - lower >= 2 * np.pi - 1e-9
        return geometry.view_directions(np.linspace(lower, upper, steps + 1)[: steps if full_turn else None, None])
    sphere = fibonacci_sphere(count)
    seen = geometry.grid_views()
    gap, nearest = nearest_points(seen, sphere)
    # the nearest view on the joint grid stands in for the sphere's point, so that every direction is truly reachable
    directions: FloatArray = seen[np.unique(nearest[gap < np.sqrt(np.pi / count)])]
    return directions
