"""A simulated plate over real photos: it clicks from recorded view to recorded view, the camera shows the photos."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from viewsep.geometry import angle_between, axis_rotation
from viewsep.kinematics import RigGeometry
from viewsep.messages import Array, FloatArray
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.view_set import ViewSet
from viewsep.sim.world import MEMORY_S, STEP_NS, Moment, load_at, physics_known_at

UP = np.array([0.0, 0.0, 1.0])


class PhotoPlate:
    """A `World` whose motors run smoothly at the joints' speeds while the plate rests only at the `rests_rad`.

    `rests_rad` (V, n) are the joint angles that show the V views; the plate is always at the one whose view lies
    closest to where the motors point, and the encoders sit on the plate. `turn_rad` is the unknown angle at which the
    object stands on it. Steps lie on a fixed grid of simulated time.
    """

    encoder_on_load = True

    def __init__(
        self,
        geometry: RigGeometry,
        clock: SimClock,
        disturbances: Disturbances,
        rests_rad: FloatArray,
        turn_rad: float,
    ) -> None:
        self.geometry = geometry
        self.clock = clock
        self.disturbances = disturbances
        self.grasp = axis_rotation(UP, turn_rad)
        self.moments: deque[Moment] = deque(maxlen=round(MEMORY_S * 1e9 / STEP_NS))
        self.setpoint_rad: tuple[float, ...] = ()
        self._rests_rad = rests_rad
        self._views = geometry.view_directions(rests_rad)
        self._furthest_rad = np.array([limit.max_speed_rad_s for limit in geometry.limits]) * STEP_NS * 1e-9
        self._open = False

    def open(self) -> None:
        """The plate starts at the view closest to joint angles of zero."""
        with self.clock.lock:
            if self._open:
                return
            self._open = True
            now = self.clock.now_ns()
            home = self._rest_at([min(max(0.0, limit.lower_rad), limit.upper_rad) for limit in self.geometry.limits])
            self._next_step_ns = (now // STEP_NS + 1) * STEP_NS
            self.moments.append(Moment(now, home, home))
            self.drive(home)
            self.clock.on_advance = self._advance

    def drive(self, setpoint_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving to the rest closest to the set-points, which is returned."""
        with self.clock.lock:
            self.setpoint_rad = self._rest_at(setpoint_rad)
            return self.setpoint_rad

    def object_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> world at a moment: what the camera sees."""
        self.clock.sleep_until(physics_known_at(stamp_ns))
        with self.clock.lock:
            load = load_at(self.moments, stamp_ns)
        return self.geometry.holder_rotation(load.tolist()) @ self.grasp

    def grasp_at(self, _stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control: photos do not slip."""
        return self.grasp

    def close(self) -> None:
        """Stop following the clock. Safe to call twice."""
        with self.clock.lock:
            self.clock.on_advance = lambda _from_ns, _to_ns: None
            self._open = False

    def _rest_at(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """The joint angles of the view closest to what the given ones (n,) show, free joints with whole turns."""
        nearest = int(np.argmin(angle_between(self._views, self.geometry.view_direction(position_rad))))
        rest = self._rests_rad[nearest]
        turned = rest + 2.0 * np.pi * np.round((np.asarray(position_rad) - rest) / (2.0 * np.pi))
        free = [np.isinf(limit.lower_rad) and np.isinf(limit.upper_rad) for limit in self.geometry.limits]
        return tuple(np.where(free, turned, rest).tolist())

    def _advance(self, _from_ns: int, to_ns: int) -> None:
        while self._next_step_ns <= to_ns:
            before = self.moments[-1]
            motor, plate = before.motor_rad, before.load_rad
            if motor != self.setpoint_rad:
                way = np.subtract(self.setpoint_rad, motor)
                there = np.abs(way) <= self._furthest_rad
                step = np.clip(way, -self._furthest_rad, self._furthest_rad)
                motor = tuple(np.where(there, self.setpoint_rad, motor + step).tolist())
                plate = self._rest_at(motor)
            clicks = plate != before.load_rad
            if clicks:  # a jump between two nanoseconds, so that whatever is exposed or read lies on one side of it
                self.moments.append(Moment(self._next_step_ns - 1, before.motor_rad, before.load_rad, click=True))
            self.moments.append(Moment(self._next_step_ns, motor, plate, clicks))
            self._next_step_ns += STEP_NS


class Photos:
    """Photos of an object instead of renders, by the direction they were taken from; all are decoded at once.

    `shown` are the indices of the views to use, `size_px` the largest size. Raises BadInput for a photo that cannot be
    used.
    """

    def __init__(self, view_set: ViewSet, shown: Sequence[int], size_px: int) -> None:
        self._directions = view_set.directions[list(shown)]
        self._pictures = [view_set.picture(index, size_px) for index in shown]

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> tuple[Array, Array]:
        """The photo taken from the direction closest to the camera's, and its mask."""
        seen_from = rotation.T @ camera_direction
        return self._pictures[int(np.argmin(angle_between(self._directions, seen_from)))]

    def close(self) -> None:
        """Nothing to release."""
