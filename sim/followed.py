"""The scene of a rig whose joints are elsewhere: the object goes where they say they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.world import Grip

JointsAt = Callable[[int], Sequence[float]]
"""Joint angles (n,) at a moment of the last seconds; waits until they are known, on the scene's clock."""


class FollowedJoints:
    """A `Scene` that follows emulated or real joints: a simulated camera beside them sees what they would show."""

    def __init__(
        self,
        geometry: RigGeometry,
        clock: SimClock,
        seed: int,
        disturbances: Disturbances,
        joints_at: JointsAt,
        grasp: FloatArray | None = None,
    ) -> None:
        self.geometry = geometry
        self.clock = clock
        self.disturbances = disturbances
        self._grip = Grip(seed, disturbances, grasp)
        self._joints_at = joints_at

    def open(self) -> None:
        """The joints are opened by whoever drives them."""

    def object_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> world at a moment: what the camera sees. Waits until the joints are known."""
        return self.geometry.holder_rotation(self._joints_at(stamp_ns)) @ self.grasp_at(stamp_ns)

    def grasp_at(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment, the slip included."""
        return self._grip.rotation_at(stamp_ns)

    def close(self) -> None:
        """Nothing to leave."""
