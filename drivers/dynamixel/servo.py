"""One servo of a rig: who it must be, how it is prepared, what its registers say in the joint's terms."""

from __future__ import annotations

import math
from dataclasses import dataclass

from viewsep.drivers.dynamixel.alerts import in_words
from viewsep.drivers.dynamixel.bus import Bus, wait_for
from viewsep.drivers.dynamixel.control_table import STEPS_PER_TURN, ControlTable, control_table
from viewsep.drivers.dynamixel.errors import ServoRefused
from viewsep.drivers.dynamixel.registers import Registers
from viewsep.drivers.dynamixel.settings import EXTENDED_COUNTS, ServoSettings
from viewsep.errors import MoveRefused, RigError

ANSWERS_ALL = 2  # Status Return Level
PROFILE_ONGOING = 0x02  # bit of Moving Status
WATCHDOG_STOPPED = -1
LONGEST_WATCHDOG = 127
REBOOT_S = 3.0
STATE_FIRST, STATE_LAST = "Moving", "Present Position"  # read in every cycle


@dataclass(frozen=True, slots=True)
class Reading:
    """What a servo says of its motion: position in counts, whether it stands still, current or load."""

    counts: int
    speed_rad_s: float
    still: bool
    effort: float


class Servo(Registers):
    """A servo on a bus. `turn_counts` makes up for whole turns it has forgotten, being started anew."""

    def __init__(self, bus: Bus, settings: ServoSettings, table: ControlTable) -> None:
        super().__init__(bus, settings.servo_id, table)
        self.settings = settings
        self.turn_counts = 0
        self.effort = "Present Current" if "Present Current" in table else "Present Load"
        start = self.state_block[0]
        self._at = {
            name: table[name].address - start
            for name in (STATE_FIRST, "Moving Status", self.effort, "Present Velocity", STATE_LAST)
        }

    @property
    def name(self) -> str:
        """For sentences."""
        return f"servo {self.settings.servo_id} (joint {self.settings.joint.name!r})"

    @property
    def state_block(self) -> tuple[int, int]:
        """First address and number of bytes of what is read in every cycle."""
        first = self.table[STATE_FIRST].address
        return first, self.table[STATE_LAST].end - first

    def interpret(self, data: bytes, before: Reading | None) -> Reading:
        """The bytes of `state_block`."""

        def value(name: str) -> int:
            register, at = self.table[name], self._at[name]
            return register.decode(data[at : at + register.size])

        counts, velocity = value(STATE_LAST), value("Present Velocity")
        profile_ongoing = bool(value("Moving Status") & PROFILE_ONGOING)
        turned = before is None or abs(counts - before.counts) > 1
        speed = velocity * self.table["Present Velocity"].scale * self.settings.direction / self.settings.gear_ratio
        still = not profile_ongoing and abs(velocity) <= 1 and not turned
        return Reading(counts, speed, still, value(self.effort) * self.table[self.effort].scale)

    def angle_rad(self, counts: int) -> float:
        """The joint's angle at a position the servo reports."""
        return self.settings.angle_rad(counts + self.turn_counts)

    def goal_counts(self, angle_rad: float) -> int:
        """The servo's goal for an angle within the limits. Raises MoveRefused beyond its 256 turns."""
        goal = self.settings.counts(angle_rad) - self.turn_counts
        if self.settings.extended and abs(goal) > EXTENDED_COUNTS:
            raise MoveRefused(
                f"{self.name} has turned to the end of its 256 turns: connect anew, which counts from zero"
            )
        return goal

    def count_from(self, known_counts: int | None) -> None:
        """Make up for whole turns: be where it was known to be, or with a gear of 1 nearest to the middle of the range.

        The middle of a joint without limits is zero.
        """
        if not self.settings.extended:
            return
        present = self.read("Present Position")
        turns = 0
        if known_counts is not None:
            turns = round((known_counts - present) / STEPS_PER_TURN)
        elif self.settings.gear_ratio == 1.0:
            turns = round((self.settings.middle_counts - present) / STEPS_PER_TURN)
        self.turn_counts = turns * STEPS_PER_TURN

    def alert(self) -> str:
        """Its hardware error in words, empty for none. Raises BusError."""
        return in_words(self.read("Hardware Error Status"))

    def prepare(self) -> None:
        """Bring it into the state the configuration wants and let it hold where it is.

        Raises RigError; where its limits do not allow what the configuration promises, nothing is changed.
        """
        self.check_limits()
        self.restore()

    def restore(self) -> None:
        """The configuration's mode and profile, and hold. Raises RigError.

        Registers in EEPROM are written only where they differ; the torque is off for that moment alone.
        """
        wanted = self.settings
        self.arm(0.0)
        if self.read("Operating Mode") != wanted.operating_mode:
            self.write("Torque Enable", 0)
            self.write("Operating Mode", wanted.operating_mode)
        if self.read("Drive Mode") & 0x04:
            self.write("Torque Enable", 0)
            self.write("Drive Mode", self.read("Drive Mode") & ~0x04)  # profiles in speeds, not in times
        self.write("Profile Velocity", self.speed_counts)
        self.write("Profile Acceleration", self.acceleration_counts)
        self.hold()

    def hold(self) -> None:
        """Turn the torque on where it is: a goal from before would be driven to. Raises RigError."""
        present = self.read("Present Position")
        try:
            self.write("Goal Position", present)
        except ServoRefused as error:
            raise RigError(
                f"{self.name} is at position {present}, beyond its own Min and Max Position Limit: turn the joint back "
                "by hand, or widen them"
            ) from error
        self.write("Torque Enable", 1)

    def arm(self, watchdog_s: float) -> None:
        """Have it stop by itself when it hears nothing for so long; 0 disarms and clears that it has stopped.

        Raises BusError.
        """
        counts = math.ceil(watchdog_s / self.table["Bus Watchdog"].scale)
        self.write("Bus Watchdog", min(counts, LONGEST_WATCHDOG))

    def release(self) -> None:
        """Let the joint go. Raises BusError."""
        self.write("Torque Enable", 0)

    def restart_if_alert(self) -> None:
        """Start it anew where it has a hardware error, the only way to clear one. Raises RigError when it remains."""
        if self.alert():
            self._bus.reboot(self._servo_id)
            wait_for(self._bus, self._servo_id, REBOOT_S)
            if remaining := self.alert():
                raise RigError(f"{self.name}: {remaining} (it was started anew, which did not help)")

    def braking_goal(self, reading: Reading) -> int:
        """Where the profile's acceleration brings it to rest, so that it need not turn back; within the limits."""
        way_rad = math.copysign(reading.speed_rad_s**2 / (2.0 * self.acceleration_rad_s2), reading.speed_rad_s)
        way = self.settings.direction * way_rad / self.settings.step_rad
        here = reading.counts + self.turn_counts
        lowest, highest = self.settings.counts_range()
        goal = min(max(here + way, min(lowest, here)), max(highest, here))  # beyond a limit it stays where it is
        return round(goal) - self.turn_counts

    def confirm_goal(self, goal: int) -> None:
        """Make sure that it has a goal that was sent to all: it may have missed it. Raises BusError."""
        if self.read("Goal Position") != goal:
            self.write("Goal Position", goal)

    @property
    def speed_counts(self) -> int:
        """Profile Velocity for the joint's speed, rounded down; 0 would mean no limit."""
        speed = self.settings.joint.max_speed_rad_s * self.settings.gear_ratio
        return max(1, math.floor(speed / self.table["Profile Velocity"].scale))

    @property
    def acceleration_counts(self) -> int:
        """Profile Acceleration for the joint's acceleration, rounded down; 0 would mean no limit."""
        acceleration = self.settings.acceleration_rad_s2 * self.settings.gear_ratio
        return max(1, math.floor(acceleration / self.table["Profile Acceleration"].scale))

    @property
    def acceleration_rad_s2(self) -> float:
        """The joint's acceleration as the servo rounds it."""
        return self.acceleration_counts * self.table["Profile Acceleration"].scale / self.settings.gear_ratio

    def travel_time_s(self, distance_rad: float) -> float:
        """How long the profile takes: a trapezoid, or a triangle where the way is short."""
        speed = self.speed_counts * self.table["Profile Velocity"].scale / self.settings.gear_ratio
        acceleration = self.acceleration_rad_s2
        distance = abs(distance_rad)
        if distance * acceleration < speed * speed:
            return 2.0 * math.sqrt(distance / acceleration)
        return distance / speed + speed / acceleration

    def check_limits(self) -> None:
        """The servo's own limits must allow what the rig's promise. Raises RigError."""
        joint = self.settings.joint
        fastest = self.read("Velocity Limit")
        if self.speed_counts > fastest:
            allowed = math.degrees(fastest * self.table["Velocity Limit"].scale / self.settings.gear_ratio)
            raise RigError(
                f"{self.name}: max_speed_deg_s = {math.degrees(joint.max_speed_rad_s):g} is above the servo's Velocity "
                f"Limit of {allowed:.0f} deg/s: lower it, or raise the limit in the servo"
            )
        if self.settings.extended:
            return
        lower, upper = self.read("Min Position Limit"), self.read("Max Position Limit")
        lowest, highest = self.settings.counts_range()
        if lowest < lower - 1 or highest > upper + 1:
            raise RigError(
                f"{self.name}: the rig's limits are positions {lowest:.0f} to {highest:.0f}, but the servo's Min and "
                f"Max Position Limit are {lower} and {upper}: narrow the rig's limits, or widen the servo's"
            )


def handshake(bus: Bus, wanted: tuple[ServoSettings, ...]) -> tuple[Servo, ...]:
    """The servos that must be there, set to answer everything.

    Raises RigError that lists the missing, the wrong and the unexpected ones.
    """
    answers = {found.servo_id: found for found in bus.ping_each([servo.servo_id for servo in wanted])}
    problems = []
    for servo in wanted:
        found = answers.get(servo.servo_id)
        who = f"servo {servo.servo_id} (joint {servo.joint.name!r})"
        if found is None:
            problems.append(f"{who} does not answer")
        elif servo.model and found.model != servo.model.upper():
            problems.append(f"{who} is a {found.model}, not a {servo.model}")
    if problems:
        strangers = [found for found in bus.ping_all() if found.servo_id not in {servo.servo_id for servo in wanted}]
        if strangers:
            problems.append(
                "unexpected: " + ", ".join(f"{found.model} with id {found.servo_id}" for found in strangers)
            )
        raise RigError(
            f"{bus.port} at {bus.baud} baud: {'; '.join(problems)}: check power, cables, ids and baud with "
            "`viewsep rig scan`"
        )
    servos = []
    for servo in wanted:
        table = control_table(answers[servo.servo_id].model_number, answers[servo.servo_id].firmware)
        bus.write_unanswered(servo.servo_id, table["Status Return Level"], ANSWERS_ALL)
        servos.append(Servo(bus, servo, table))
    return tuple(servos)
