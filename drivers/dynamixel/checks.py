"""What is looked at in one servo: is it the right one, is it well, is it set up for its joint."""

from __future__ import annotations

import math
from collections.abc import Iterator

from viewsep.drivers.checks import Check, Verdict, check
from viewsep.drivers.dynamixel.alerts import in_words
from viewsep.drivers.dynamixel.bus import Bus, Found
from viewsep.drivers.dynamixel.control_table import control_table, x_series
from viewsep.drivers.dynamixel.errors import BusError
from viewsep.drivers.dynamixel.health import HealthLimits
from viewsep.drivers.dynamixel.registers import Registers
from viewsep.drivers.dynamixel.servo import ANSWERS_ALL, Servo
from viewsep.drivers.dynamixel.settings import ServoSettings
from viewsep.errors import RigError

WATCHDOG_FIRMWARE = 38  # the 330 servos have had it from the beginning
SHUTDOWN = {2: "overheating", 4: "an electrical shock", 5: "overload"}  # bits that should take the torque off
SAFE = sum(1 << bit for bit in SHUTDOWN)
OPERATING_V = (  # the e-manual's input voltages; models that are not here are checked against their own limits only
    (("XL330", "XC330-M"), 3.7, 6.0),
    (("XL430", "2XL430", "XC330-T"), 6.5, 12.0),
    (("XC430", "2XC430"), 6.5, 14.8),
    (("XM", "XH430-W", "XH540-W"), 10.0, 14.8),
)
SLACK_V = 0.3  # of supplies and of the servos' own measurement


def servo_checks(bus: Bus, found: Found, wanted: ServoSettings | None, configured: bool, fix: bool) -> Iterator[Check]:
    """Of one servo that answers; `wanted` is what the configuration (if `configured`) has with its id.

    With `fix` the return delay becomes 0. Raises PortLost.
    """
    who = f"servo {found.servo_id}"
    if wanted is not None:
        who += f" (joint {wanted.joint.name!r})"
        right = not wanted.model or wanted.model.upper() == found.model
        remedy = f"the configuration says {wanted.model}: exchange the servo or correct the file"
        yield check(f"{who}: model", right, found.model, remedy)
    else:
        remedy = "no joint of the configuration has this id" if configured else ""
        yield check(f"{who}: model", not configured, found.model, remedy, Verdict.BETTER)
    if found.model_number not in x_series():
        if wanted is not None:
            yield Check(f"{who}: series", Verdict.BAD, found.model, "use a servo of the X series")
        return
    good = found.firmware >= WATCHDOG_FIRMWARE or "330" in found.model
    remedy = f"update it with DYNAMIXEL Wizard: before {WATCHDOG_FIRMWARE} there is no bus watchdog"
    yield check(f"{who}: firmware", good, str(found.firmware), remedy)
    servo = Registers(bus, found.servo_id, control_table(found.model_number, found.firmware))
    try:
        yield from _health(servo, who, wanted)
        yield from _answering(servo, who, fix)
        if wanted is not None:
            yield from _joint(Servo(bus, wanted, servo.table), who)
    except RigError as error:
        if not bus.is_open:
            raise
        yield Check(f"{who}: registers", Verdict.BAD, str(error), "if it answers pings only, switch it off and on")


def _health(servo: Registers, who: str, wanted: ServoSettings | None) -> Iterator[Check]:
    errors = in_words(servo.read("Hardware Error Status"))
    remedy = "then `viewsep clear-fault`, or switch it off and on"
    yield check(f"{who}: hardware", not errors, errors or "no error", remedy)
    limits = HealthLimits.of(servo, wanted)
    hot, hottest = servo.read_si("Present Temperature"), limits.hottest_c
    yield check(f"{who}: temperature", hot <= hottest, f"{hot:.0f} of at most {hottest:.0f} degC", "let it cool down")
    volts, lowest, highest = servo.read_si("Present Input Voltage"), limits.lowest_v, limits.highest_v
    said = f"{volts:.1f} V, allowed {lowest:.1f} to {highest:.1f} V"
    yield check(f"{who}: supply", lowest <= volts <= highest, said, "check the supply and the cables")
    for models, low, high in OPERATING_V:
        if servo.table.model.startswith(models) and lowest <= volts <= highest:
            good = low - SLACK_V <= volts <= high + SLACK_V
            remedy = f"{servo.table.model} is made for {low} to {high} V: use another supply"
            yield check(f"{who}: rated voltage", good, f"{volts:.1f} V", remedy, Verdict.BETTER)
    shutdown = servo.read("Shutdown")
    missing = [what for bit, what in SHUTDOWN.items() if not shutdown >> bit & 1]
    remedy = f"{' and '.join(missing)} should take its torque off: set Shutdown to {shutdown | SAFE}"
    yield check(f"{who}: shutdown", not missing, str(shutdown), remedy, Verdict.BETTER)
    yield Check(f"{who}: torque", Verdict.GOOD, "on" if servo.read("Torque Enable") else "off")


def _answering(servo: Registers, who: str, fix: bool) -> Iterator[Check]:
    delay, torque = servo.read("Return Delay Time"), servo.read("Torque Enable")
    said = f"{delay * 2} us"
    if delay and fix and not torque:
        servo.write("Return Delay Time", 0)
        delay = servo.read("Return Delay Time")
        said = f"{said}, now {delay * 2} us"
    remedy = "0 makes every answer come sooner: `viewsep rig doctor --fix` sets it"
    if fix and torque:
        remedy = "it can be set while the torque is off only: switch the servo off and on, then try again"
    yield check(f"{who}: return delay", delay == 0, said, remedy, Verdict.BETTER)
    level = servo.read("Status Return Level")
    remedy = f"viewsep sets {ANSWERS_ALL} when it connects"
    yield check(f"{who}: status return level", level == ANSWERS_ALL, str(level), remedy, Verdict.BETTER)


def _joint(servo: Servo, who: str) -> Iterator[Check]:
    wanted, mode = servo.settings, servo.read("Operating Mode")
    remedy = f"viewsep sets {wanted.operating_mode} when it connects"
    yield check(f"{who}: operating mode", mode == wanted.operating_mode, str(mode), remedy, Verdict.BETTER)
    try:
        servo.check_limits()
        yield Check(f"{who}: limits", Verdict.GOOD, "the servo's allow the rig's")
    except BusError:
        raise
    except RigError as error:
        yield Check(f"{who}: limits", Verdict.BAD, "too narrow", str(error))
    servo.count_from(None)
    angle, limit = servo.angle_rad(servo.read("Present Position")), wanted.joint
    within = limit.lower_rad - wanted.step_rad <= angle <= limit.upper_rad + wanted.step_rad
    remedy = (
        f"the rig turns it from {math.degrees(limit.lower_rad):g} to {math.degrees(limit.upper_rad):g} deg only: turn "
        "it back by hand, or find its zero with `viewsep rig home`"
    )
    yield check(f"{who}: angle", within, f"{math.degrees(angle):.1f} deg", remedy, Verdict.BETTER)
