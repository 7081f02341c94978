"""What a servo does with its goals: the motion they mean, and the effort it takes.

Efforts are fractions of the full output. How strongly a servo presses, and how long before it calls that an overload,
the e-manual does not say: those figures are the emulation's own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from viewsep.drivers.dynamixel.control_table import STEPS_PER_TURN
from viewsep.sim.dynamixel.models import CURRENT, CURRENT_BASED, EXTENDED, POSITION, PWM, VELOCITY
from viewsep.sim.dynamixel.profile import Motion, move, rest, run
from viewsep.sim.dynamixel.registers import Registers
from viewsep.sim.dynamixel.shaft import Stretch

VELOCITY_UNIT = 0.229 * STEPS_PER_TURN / 60.0  # counts/s
ACCELERATION_UNIT = 214.577 * STEPS_PER_TURN / 3600.0  # counts/s^2
FULL_PWM = 885
FULL_EFFORT_COUNTS = 177  # position error at which a servo with factory gains gives all it has
FRICTION = 0.05
SPEED_EFFORT = 0.15  # at full speed
OVERLOAD_EFFORT = 0.8
OVERLOAD_S = 1.0  # that long above OVERLOAD_EFFORT
POSITION_MODES = (POSITION, EXTENDED, CURRENT_BASED)
SINGLE_TURN_OFFSET = 1024  # larger homing offsets are ignored in position mode


@dataclass(frozen=True, slots=True)
class Frame:
    """How the registers' positions are related to the shaft's."""

    sign: int
    offset: float

    def to_register(self, shaft: float) -> float:
        """What Present Position shows."""
        return self.sign * shaft + self.offset

    def to_shaft(self, register: float) -> float:
        """Where a Goal Position is."""
        return self.sign * (register - self.offset)


def sign_of(registers: Registers) -> int:
    """-1 in reverse mode."""
    return -1 if registers["Drive Mode"] & 1 else 1


def frame(registers: Registers, turns: int) -> Frame:
    """The frame when `turns` whole turns have been taken off since the start."""
    homing = registers["Homing Offset"]
    if registers["Operating Mode"] == POSITION and abs(homing) > SINGLE_TURN_OFFSET:
        homing = 0
    return Frame(sign_of(registers), homing - turns * STEPS_PER_TURN)


def effort_limit(registers: Registers, full_current: int) -> float:
    """The largest effort the limits and goals allow."""
    mode = registers["Operating Mode"]
    pwm = registers["PWM Limit"] if mode == PWM else min(registers["PWM Limit"], abs(registers["Goal PWM"]))
    limit = pwm / FULL_PWM
    if full_current:
        limit = min(limit, registers["Current Limit"] / full_current)
        if mode == CURRENT_BASED:
            limit = min(limit, abs(registers["Goal Current"]) / full_current)
    return limit


def driven(registers: Registers, full_current: int) -> float:
    """The effort asked for in the modes that ask for one, along the shaft."""
    mode = registers["Operating Mode"]
    goal = registers["Goal PWM"] / FULL_PWM if mode == PWM else registers["Goal Current"] / max(full_current, 1)
    return sign_of(registers) * goal


def spare_effort(registers: Registers, load: float, full_current: int) -> float:
    """What the load leaves of the output, for speed; below 0 it cannot move."""
    if registers["Operating Mode"] in (PWM, CURRENT):
        return abs(driven(registers, full_current)) - abs(load)
    return effort_limit(registers, full_current) - abs(load)


def plan(
    registers: Registers, where: Frame, goal_error: float, start: tuple[float, float], spare: float, full_current: int
) -> Motion:
    """From a position and velocity of the shaft towards the goal, with `spare` of the full output for speed."""
    position, velocity = start
    mode = registers["Operating Mode"]
    fastest = registers["Velocity Limit"] * VELOCITY_UNIT * spare
    if fastest <= 0.0:
        return rest(position)
    if mode in POSITION_MODES:
        goal = where.to_shaft(registers["Goal Position"]) + goal_error
        speed, acceleration = _profile(registers, abs(goal - position))
        return move(position, velocity, goal, min(speed, fastest), acceleration)
    if mode == VELOCITY:
        speed = sign_of(registers) * registers["Goal Velocity"] * VELOCITY_UNIT
        acceleration = registers["Profile Acceleration"] * ACCELERATION_UNIT or math.inf
        return run(position, velocity, max(-fastest, min(fastest, speed)), acceleration)
    return run(position, 0.0, math.copysign(fastest, driven(registers, full_current)), math.inf)


def _profile(registers: Registers, distance: float) -> tuple[float, float]:
    """Speed and acceleration of the profile; 0 in a register is no limit."""
    velocity, acceleration = registers["Profile Velocity"], registers["Profile Acceleration"]
    if not registers["Drive Mode"] & 4:
        return velocity * VELOCITY_UNIT or math.inf, acceleration * ACCELERATION_UNIT or math.inf
    total_s, ramp_s = velocity * 1e-3, min(acceleration, velocity / 2) * 1e-3
    if not total_s or not distance:
        return math.inf, math.inf
    speed = distance / (total_s - ramp_s)
    return speed, speed / ramp_s if ramp_s else math.inf


def effort(registers: Registers, stretch: Stretch, stamp_ns: int, load: float, full_current: int) -> float:
    """The effort along the shaft at a time, torque being on."""
    mode = registers["Operating Mode"]
    limit = effort_limit(registers, full_current)
    seconds = stretch.seconds(stamp_ns)
    if mode in (PWM, CURRENT):
        asked = driven(registers, full_current)
    elif seconds < stretch.blocked_s:
        velocity = stretch.velocity(stamp_ns)
        relative = velocity / (registers["Velocity Limit"] * VELOCITY_UNIT or 1.0)
        asked = load + math.copysign(FRICTION, velocity) * (velocity != 0.0) + SPEED_EFFORT * relative
    elif mode == VELOCITY:
        asked = math.copysign(1.0, stretch.motion.velocity_at(seconds))
    else:
        asked = (stretch.motion.position_at(seconds) - stretch.position(stamp_ns)) / FULL_EFFORT_COUNTS
    return max(-limit, min(limit, asked))


def strained_s(registers: Registers, stretch: Stretch, load: float, full_current: int) -> float:
    """When the effort of a stretch comes to OVERLOAD_EFFORT, in seconds from its start; infinite: never."""
    mode = registers["Operating Mode"]
    if effort_limit(registers, full_current) < OVERLOAD_EFFORT:
        return math.inf
    if mode in (PWM, CURRENT):
        return stretch.blocked_s if abs(driven(registers, full_current)) >= OVERLOAD_EFFORT else math.inf
    if math.isinf(stretch.blocked_s):
        return 0.0 if abs(load) >= OVERLOAD_EFFORT else math.inf
    if mode == VELOCITY:
        return stretch.blocked_s
    held = stretch.motion.position_at(stretch.blocked_s)
    upwards = stretch.motion.goal > held
    level = held + math.copysign(OVERLOAD_EFFORT * FULL_EFFORT_COUNTS, stretch.motion.goal - held)
    return stretch.motion.passing(level, upwards)
