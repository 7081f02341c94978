"""What a bus of servos is set up with, and how a joint's angle becomes a servo's counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from viewsep.drivers.dynamixel.control_table import STEP_RAD, STEPS_PER_TURN, x_series
from viewsep.errors import BadConfig
from viewsep.interfaces import JointLimits

EXTENDED_COUNTS = 1_048_575  # a goal in extended-position mode lies within plus and minus this
POSITION, EXTENDED_POSITION = 3, 4  # Operating Mode


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """One servo and the joint it turns.

    `zero_counts` is its position when the joint is at zero, `gear_ratio` how often it turns for one turn of the joint,
    `direction` 1, or -1 where the joint turns the other way. `model` is empty where any will do. Limits are None where
    the servo's own are enough; `effort_limit` is in A where the model measures current, otherwise a share of full load.
    """

    joint: JointLimits
    servo_id: int
    model: str = ""
    extended: bool = False
    zero_counts: int = STEPS_PER_TURN // 2
    direction: int = 1
    gear_ratio: float = 1.0
    acceleration_rad_s2: float = math.radians(300.0)
    effort_limit: float | None = None
    temperature_limit_c: float | None = None
    min_voltage_v: float | None = None
    max_voltage_v: float | None = None

    @property
    def operating_mode(self) -> int:
        """The mode register's value."""
        return EXTENDED_POSITION if self.extended else POSITION

    @property
    def step_rad(self) -> float:
        """The joint's angle of one count."""
        return STEP_RAD / self.gear_ratio

    @property
    def middle_counts(self) -> float:
        """The position in the middle of the joint's range; where it is at zero if that has no end on one side."""
        lowest, highest = self.counts_range()
        return (lowest + highest) / 2.0 if math.isfinite(highest - lowest) else self.zero_counts

    def angle_rad(self, counts: float) -> float:
        """The joint's angle at a position of the servo."""
        return self.direction * (counts - self.zero_counts) * self.step_rad

    def counts(self, angle_rad: float) -> int:
        """The position nearest to an angle that is not beyond the joint's limits."""
        counts = self.zero_counts + self.direction * round(angle_rad / self.step_rad)
        if self.angle_rad(counts) > self.joint.upper_rad:
            return counts - self.direction
        if self.angle_rad(counts) < self.joint.lower_rad:
            return counts + self.direction
        return counts

    def counts_range(self) -> tuple[float, float]:
        """Positions at the joint's limits, lower first; infinite where it has none."""
        ends = [self.zero_counts + self.direction * q / self.step_rad for q in self._limits]
        return min(ends), max(ends)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.joint.lower_rad, self.joint.upper_rad


@dataclass(frozen=True, slots=True)
class BusSettings:
    """A port and the servos on it, one for each joint in the rig's order.

    `watchdog_s`: a servo that hears nothing for this long stops by itself; 0 is off. `release` lets the joints go
    where others hold: when stopped and closed. A joint has arrived within `tolerance_rad` of its set-point after
    `still_reads` readings without motion. Without an answer for `lost_s` a servo counts as lost.
    """

    port: str
    servos: tuple[ServoSettings, ...]
    baud: int = 57600
    retries: int = 3
    state_hz: float = 100.0
    watchdog_s: float = 0.5
    release: bool = False
    tolerance_rad: float = math.radians(0.5)
    still_reads: int = 3
    lost_s: float = 0.5

    def check(self) -> None:
        """Raises BadConfig for what no servo can do, naming joint, key, value and remedy."""
        ids = [servo.servo_id for servo in self.servos]
        for servo in self.servos:
            joint = servo.joint.name
            if ids.count(servo.servo_id) > 1:
                raise BadConfig(f"joint {joint!r}: id = {servo.servo_id} is given twice: every servo has its own")
            if servo.model and servo.model.upper() not in x_series().values():
                known = ", ".join(x_series().values())
                raise BadConfig(f"joint {joint!r}: model = {servo.model!r} is unknown: choose one of {known}")
            lowest, highest = servo.counts_range()
            if not servo.extended and (lowest < 0 or highest > STEPS_PER_TURN - 1):
                raise BadConfig(
                    f"joint {joint!r}: mode = 'position' reaches 0 to {STEPS_PER_TURN - 1} counts, but its limits need "
                    f"{lowest:.0f} to {highest:.0f}: use mode = 'extended', or narrow the limits"
                )
            if (math.isfinite(lowest) and lowest < -EXTENDED_COUNTS) or (
                math.isfinite(highest) and highest > EXTENDED_COUNTS
            ):
                raise BadConfig(f"joint {joint!r}: its limits are beyond the 256 turns of a servo: narrow them")
