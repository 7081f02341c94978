"""Finding a joint's zero: turned there by hand with the torque off, or from a mechanical stop at a known angle."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

from viewsep.drivers.dynamixel.control_table import STEP_RAD
from viewsep.drivers.dynamixel.servo import Servo
from viewsep.drivers.dynamixel.settings import EXTENDED_POSITION
from viewsep.errors import Interrupted, RigError
from viewsep.interfaces import Clock

CURRENT_BASED_POSITION = 5
POLL_NS = 20_000_000
STALLED_NS = 500_000_000  # without motion for this long, it is at the stop
LONGEST_S = 60.0
WATCHDOG_S = 0.5  # a process that dies leaves no servo pressing
SPEED_RAD_S = math.radians(15.0)
BACK_RAD = math.radians(3.0)  # from the stop, so that nothing presses against it
LEAST_RAD = math.radians(1.0)  # what does not move as much was too weak to
BACK_S = BACK_RAD / SPEED_RAD_S + 0.5

Tell = Callable[[int], None]
"""Hears the servo's position in counts."""


def zero_by_hand(servo: Servo, clock: Clock, seconds: float, tell: Tell, ended: Callable[[], bool]) -> int:
    """Let the joint go, wait until somebody has turned it to zero, hold it there; returns `zero_counts`.

    It waits for `seconds`, or until `ended()`. Raises BusError.
    """
    servo.restart_if_alert()
    servo.arm(0.0)
    servo.release()
    _watch(servo, clock, seconds, tell, ended)
    zero = servo.read("Present Position")
    servo.restore()
    return servo.settings.with_zero(zero).zero_counts


def zero_at_stop(
    servo: Servo, clock: Clock, direction: int, stop_rad: float, effort: float, tell: Tell, ended: Callable[[], bool]
) -> int:
    """Drive gently against a mechanical stop that is at `stop_rad`, back off, hold; returns `zero_counts`.

    `direction` is the joint's, 1 or -1; `effort` a share of full output, or A where the model controls current. Raises
    RigError when no stop is met, Interrupted when `ended()` before.
    """
    wanted = servo.settings
    turning = direction * wanted.direction
    servo.restart_if_alert()  # with an alert it would stand still, as if at the stop
    try:
        stop = _press(servo, clock, turning, effort, tell, ended)
        servo.write("Goal Position", stop - turning * round(BACK_RAD / wanted.step_rad))
        _watch(servo, clock, BACK_S, tell, lambda: False)
    except BaseException:
        with suppress(RigError):  # what went wrong first is told
            _recover(servo)
        raise
    _recover(servo)
    return wanted.with_zero(stop - wanted.direction * round(stop_rad / wanted.step_rad)).zero_counts


def _recover(servo: Servo) -> None:
    """Hold, with the strength and in the mode that the configuration wants. Raises RigError."""
    servo.arm(0.0)
    servo.hold()  # before it has its strength back
    for limited in ("PWM", "Current"):
        if f"Goal {limited}" in servo.table:
            servo.write(f"Goal {limited}", servo.read(f"{limited} Limit"))
    servo.restore()


def _press(servo: Servo, clock: Clock, turning: int, effort: float, tell: Tell, ended: Callable[[], bool]) -> int:
    """Turn slowly with little effort until nothing moves; returns the position."""
    by_current = "Goal Current" in servo.table
    limiting = servo.table["Goal Current" if by_current else "Goal PWM"]
    servo.arm(0.0)
    servo.release()
    servo.write("Operating Mode", CURRENT_BASED_POSITION if by_current else EXTENDED_POSITION)
    speed = max(1, round(SPEED_RAD_S * servo.settings.gear_ratio / servo.table["Profile Velocity"].scale))
    servo.write("Profile Velocity", speed)
    servo.hold()
    servo.write(limiting.name, max(1, round(effort / limiting.scale)))
    servo.arm(WATCHDOG_S)
    begin = last = servo.read("Present Position")
    turns = round(2.0 * math.pi * servo.settings.gear_ratio / STEP_RAD)
    servo.write("Goal Position", begin + turning * turns)
    moved_ns, until_ns = clock.now_ns(), clock.now_ns() + round(LONGEST_S * 1e9)
    while clock.now_ns() - moved_ns < STALLED_NS:
        if ended():
            raise Interrupted(f"{servo.name}: stopped before it met its mechanical stop; zero_counts stays as it was")
        if clock.now_ns() > until_ns or abs(last - begin) >= turns - 1:
            raise RigError(f"{servo.name} met no mechanical stop within one turn of the joint: is there one?")
        position = servo.read("Present Position")
        tell(position)
        if abs(position - last) > 1:
            last, moved_ns = position, clock.now_ns()
        clock.sleep_until(clock.now_ns() + POLL_NS)
    if alert := servo.alert():
        raise RigError(f"{servo.name}: {alert}; zero_counts stays as it was")
    stop = servo.read("Present Position")
    if abs(stop - begin) * servo.settings.step_rad < LEAST_RAD:
        raise RigError(
            f"{servo.name} did not move: raise --effort, or turn the joint away from the stop where it is there already"
        )
    return stop


def _watch(servo: Servo, clock: Clock, seconds: float, tell: Tell, ended: Callable[[], bool]) -> None:
    """Read the position for some time."""
    until_ns = clock.now_ns() + round(seconds * 1e9)
    while clock.now_ns() < until_ns and not ended():
        tell(servo.read("Present Position"))
        clock.sleep_until(clock.now_ns() + POLL_NS)
