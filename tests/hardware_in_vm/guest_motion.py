"""In the machine: the motion driver on the kernel's port, with the adapter pulled out in the middle of a move."""

from __future__ import annotations

import math
import time
from pathlib import Path

from guest_adapter import check_adapter, wait_for_adapter
from steps import expect, say, step, wait_until

from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.errors import MoveRefused, RigError
from viewsep.interfaces import JointLimits

SPEED = math.radians(40.0)
NEAR, FAR = math.radians(20.0), math.radians(-100.0)
UNDER_WAY = math.radians(10.0)  # so far on its way the adapter is pulled out
TOLERANCE = math.radians(1.0)
MOVE_S = 10.0
TOLD_S = 3.0  # a lost adapter has to be told within
PATIENCE_S = 1.0  # watchdog and silence: an emulated processor is slow


def settings(port: str) -> BusSettings:
    """Two servos as a pan-tilt has them."""
    servos = (
        ServoSettings(JointLimits("pan", -math.pi * 0.99, math.pi * 0.99, SPEED), 1, "XL430-W250"),
        ServoSettings(JointLimits("tilt", -math.pi / 2, math.pi / 2, SPEED), 2, "XL430-W250"),
    )
    return BusSettings(port, servos, watchdog_s=PATIENCE_S, lost_s=PATIENCE_S, state_hz=50.0)


def check_motion() -> None:
    """Connect, move, lose the adapter, get it back, move again."""
    with step("the driver connects and moves") as note:
        port = wait_for_adapter()
        motion = DynamixelMotion(settings(port), MonotonicClock())
        motion.connect()
        note(f"{Path(port).resolve()}")
        note(arrive(motion, NEAR))
        note(state_rate(motion))
    with step("an adapter that is pulled out in the middle of a move is told") as note:
        motion.move_to([FAR, 0.0])
        wait_until("the joint to be on its way", MOVE_S, lambda: pan(motion) < NEAR - UNDER_WAY)
        say("@moving")
        told = lost(motion)
        note(told)
        expect(port in told, "the error does not name the port")
    with step("without it nothing moves, and the fault cannot be cleared") as note:
        note(f"move_to → {refusal(motion, lambda: motion.move_to([NEAR, 0.0]), MoveRefused)}")
        note(f"clear_fault → {refusal(motion, motion.clear_fault, RigError)}")
    say("@lost")
    with step("with it the fault is cleared, and the joints move again") as note:
        note(f"{Path(wait_for_adapter()).resolve()}")
        motion.clear_fault()
        note(f"the joint stands at {math.degrees(pan(motion)):.1f} deg")
        note(arrive(motion, FAR))
    with step("the driver closes") as note:
        note(f"{dict(motion.counters())}")
        motion.close()


def arrive(motion: DynamixelMotion, pan_rad: float) -> str:
    """Move and be there. Raises TimeoutError, AssertionError."""
    begin = time.monotonic()
    motion.move_to([pan_rad, 0.0])
    wait_until("the end of the move", MOVE_S, lambda: not motion.read_state().moving)
    expect(motion.fault() == "", motion.fault())
    expect(abs(pan(motion) - pan_rad) < TOLERANCE, f"the joint stands at {math.degrees(pan(motion)):.1f} deg")
    return f"arrived at {math.degrees(pan(motion)):.1f} deg in {time.monotonic() - begin:.1f} s"


def state_rate(motion: DynamixelMotion) -> str:
    """How often the state is read."""
    stamps = [state.stamp_ns for state in motion.history(0)]
    return f"{len(stamps)} states at {(len(stamps) - 1) / (stamps[-1] - stamps[0]) * 1e9:.0f} Hz"


def lost(motion: DynamixelMotion) -> str:
    """The error that reading the state raises once the adapter is gone. Raises TimeoutError."""

    def error() -> RigError | None:
        try:
            motion.read_state()
        except RigError as error:
            return error
        return None

    told = wait_until("an error from read_state()", TOLD_S, error)
    expect(motion.fault() != "", "there is no fault")
    return f"{type(told).__name__}: {told}"


def refusal(motion: DynamixelMotion, call: object, kind: type[RigError]) -> str:
    """What a call says that has to be refused."""
    assert callable(call)
    try:
        call()
    except kind as error:
        expect(motion.fault() != "", "the fault is gone though nothing was repaired")
        return f"{type(error).__name__}: {error}"
    raise AssertionError("it was not refused")


def pan(motion: DynamixelMotion) -> float:
    """Where the first joint is, in rad."""
    return motion.read_state().position_rad[0]


if __name__ == "__main__":
    check_adapter()
    check_motion()
