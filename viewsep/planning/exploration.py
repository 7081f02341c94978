"""Where to turn while the poses are not yet known (sections III.C and V)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from viewsep.geometry import (
    angle_between,
    axis_rotation,
    azimuth_elevation,
    move_along,
    perpendicular,
    spherical_direction,
    tangent_towards,
)
from viewsep.kinematics import VIEW_TOLERANCE_RAD
from viewsep.messages import FloatArray
from viewsep.planning.reachable import ReachableViews

POLE_RAD = np.radians(75.0)
PRECESSION_RAD = np.radians(1.5)  # of the great circle's plane per step, so that a second turn shows new views


@dataclass(frozen=True, slots=True)
class SphericalExploration:
    """The seed's: constant increments of azimuth and zenith angle. Near the poles it sees little that is new."""

    azimuth_rad: float
    elevation_rad: float
    azimuth_step_rad: float
    elevation_step_rad: float

    @staticmethod
    def start(rng: np.random.Generator, view: FloatArray, step_rad: float) -> SphericalExploration:
        """In a random direction from `view`."""
        azimuth, elevation = azimuth_elevation(view)
        heading = rng.uniform(0.0, 2.0 * np.pi)
        return SphericalExploration(azimuth, elevation, step_rad * np.cos(heading), step_rad * np.sin(heading))

    def next_view(self, view: FloatArray, reachable: ReachableViews) -> tuple[SphericalExploration, FloatArray]:
        """The next increment; increments that a limited rig cannot follow are skipped up to a whole turn."""
        step = np.hypot(self.azimuth_step_rad, self.elevation_step_rad)
        state, target = self, view
        for _ in range(int(np.ceil(2.0 * np.pi / step))):
            state = replace(
                state,
                azimuth_rad=state.azimuth_rad + self.azimuth_step_rad,
                elevation_rad=state.elevation_rad + self.elevation_step_rad,
            )
            target = reachable.nearest(spherical_direction(state.azimuth_rad, state.elevation_rad))
            if angle_between(target, view) > 0.25 * step * abs(np.cos(state.elevation_rad)):
                break
        if angle_between(target, view) < VIEW_TOLERANCE_RAD:  # few views, and none that way
            way = move_along(view, perpendicular(view), step)
            target = reachable.onward(view, tangent_towards(view, way))
        return state, target


@dataclass(frozen=True, eq=False, slots=True)
class GeodesicExploration:
    """Straight ahead on great circles that slowly turn, away from the control frame's poles and the rig's limits.

    `tangent` (3,) is the heading at the view it was last used at. The circles' plane turns about `pivot` (3,), which
    lies in it: a turn of the heading that is the same everywhere would only bend the path to one smaller circle.
    """

    tangent: FloatArray
    step_rad: float
    pivot: FloatArray

    @staticmethod
    def start(rng: np.random.Generator, view: FloatArray, step_rad: float) -> GeodesicExploration:
        """In a random direction from `view`."""
        heading = axis_rotation(view, rng.uniform(0.0, 2.0 * np.pi)) @ perpendicular(view)
        return GeodesicExploration(heading, step_rad, view)

    def next_view(self, view: FloatArray, reachable: ReachableViews) -> tuple[GeodesicExploration, FloatArray]:
        """One step ahead, or as little to the side as the limits ask for."""
        ahead = tangent_towards(view, move_along(view, self.tangent, self.step_rad))
        precession = 2.0 * PRECESSION_RAD * float(self.pivot @ view)  # how a path bends on a sphere that turns
        if reachable.single:
            return self._next_single(view, axis_rotation(view, precession) @ ahead, reachable)
        best, best_turn = view, np.inf
        for turn in np.radians([0, 15, -15, 30, -30, 50, -50, 75, -75, 105, -105, 140, -140, 180]):
            heading = axis_rotation(view, turn + precession) @ ahead
            target = reachable.nearest(move_along(view, heading, self.step_rad))
            travelled = angle_between(view, target)
            leaves_pole = abs(azimuth_elevation(target)[1]) <= max(POLE_RAD, abs(azimuth_elevation(view)[1]))
            if travelled > 0.5 * self.step_rad and leaves_pole and abs(turn) < best_turn:
                best, best_turn = target, abs(turn)
                break
        return replace(self, tangent=_carried(view, best, ahead)), best

    def _next_single(
        self, view: FloatArray, ahead: FloatArray, reachable: ReachableViews
    ) -> tuple[GeodesicExploration, FloatArray]:
        """From view to neighbouring view, about one step or as far as the next one is; turning around at an edge."""
        here, heading = view, ahead
        for _ in range(max(1, round(self.step_rad / reachable.spacing_rad))):
            there = reachable.onward(here, heading)
            turns_around = tangent_towards(here, there) @ heading < 0.0
            if here is not view and (turns_around or angle_between(view, here) > 0.75 * self.step_rad):
                break
            here, heading = there, _carried(here, there, heading)
        return replace(self, tangent=heading), here


def _carried(start: FloatArray, end: FloatArray, heading: FloatArray) -> FloatArray:
    """The heading (3,) at `end` after going straight there from `start`; unchanged when nothing moved."""
    tangent = tangent_towards(end, start)
    return -tangent if tangent.any() else heading


Exploration = Literal["geodesic", "spherical"]
EXPLORATIONS: dict[Exploration, type[GeodesicExploration | SphericalExploration]] = {
    "geodesic": GeodesicExploration,
    "spherical": SphericalExploration,
}
