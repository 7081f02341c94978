"""The simulated rig's motion backend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from viewsep.errors import NotConnected
from viewsep.interfaces import JointLimits
from viewsep.kinematics import check_setpoints
from viewsep.messages import JointState
from viewsep.sim.world import STEP_NS, Moment, World

READ_EVERY = 4  # physics steps between two encoder readings: 62.5 Hz
ENCODER_STEP_RAD = 2.0 * np.pi / 4096
MOVING_RAD = np.radians(0.02)  # change from one reading to the next


class SimMotion:
    """`MotionBackend` on a simulated world, for any number of threads.

    The encoders have steps; where they sit is the world's choice.
    """

    def __init__(self, world: World, seed: int = 0) -> None:
        self._world = world
        self._seed = seed
        self._connected = False

    def connect(self) -> None:
        """Open the world."""
        self._world.open()
        self._connected = True

    def limits(self) -> tuple[JointLimits, ...]:
        """The rig's limits."""
        return self._world.geometry.limits

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving; set-points are rounded to the encoder's steps, and by the world to where it can rest."""
        self._check()
        limits = self.limits()
        check_setpoints(position_rad, limits)
        commanded = [_rounded(q, limit) for q, limit in zip(position_rad, limits, strict=True)]
        with self._world.clock.lock:
            self._world.clock.now_ns()  # what was commanded before acts until now
            return self._world.drive(commanded)

    def read_state(self) -> JointState:
        """The newest encoder reading."""
        self._check()
        with self._world.clock.lock:
            return self._readings(self._world.clock.now_ns())[-1]

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Encoder readings from the last one at or before `since_ns` on."""
        self._check()
        with self._world.clock.lock:
            self._world.clock.now_ns()
            return self._readings(since_ns)

    def stop(self) -> None:
        """Hold where the joints are."""
        self._check()
        with self._world.clock.lock:
            self._world.clock.now_ns()
            self._world.drive(self._world.moments[-1].motor_rad)

    def fault(self) -> str:
        """The simulation has none."""
        return ""

    def clear_fault(self) -> None:
        """There is nothing to clear."""

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The simulation knows no heat."""
        return (None,) * len(self.limits())

    def counters(self) -> Mapping[str, int]:
        """There is no way to a device."""
        return {}

    def close(self) -> None:
        """Leave the world."""
        self._connected = False
        self._world.close()

    def _check(self) -> None:
        if not self._connected:
            raise NotConnected("the simulated motion is not connected: call connect() first")

    def _readings(self, since_ns: int) -> tuple[JointState, ...]:
        """Readings are a function of the physics' memory and the seed, so asking twice gives the same answer."""
        moments = self._world.moments
        period_ns = READ_EVERY * STEP_NS
        chosen = []
        for index in range(len(moments) - 1, -1, -1):
            moment = moments[index]
            if moment.stamp_ns % period_ns == 0 or moment.click or index == 0:
                before = moments[max(0, index - READ_EVERY)]
                moved = max(abs(a - b) for a, b in zip(moment.motor_rad, before.motor_rad, strict=True))
                chosen.append(self._reading(moment, bool(moved > MOVING_RAD)))
                if moment.stamp_ns <= since_ns:
                    break
        return tuple(reversed(chosen))

    def _reading(self, moment: Moment, moving: bool) -> JointState:
        sigma = float(np.radians(self._world.disturbances.encoder_noise_deg))
        angles = moment.load_rad if self._world.encoder_on_load else moment.motor_rad
        if sigma > 0:
            rng = np.random.default_rng([self._seed, 2, moment.stamp_ns])
            angles = tuple((angles + rng.normal(0.0, sigma, len(angles))).tolist())
        steps = tuple(round(q / ENCODER_STEP_RAD) * ENCODER_STEP_RAD for q in angles)
        return JointState(moment.stamp_ns, steps, self._world.setpoint_rad, moving)


def _rounded(position_rad: float, limit: JointLimits) -> float:
    """The encoder step nearest to a set-point within the limits."""
    steps = round(position_rad / ENCODER_STEP_RAD)
    if steps * ENCODER_STEP_RAD > limit.upper_rad:
        steps -= 1
    elif steps * ENCODER_STEP_RAD < limit.lower_rad:
        steps += 1
    return steps * ENCODER_STEP_RAD
