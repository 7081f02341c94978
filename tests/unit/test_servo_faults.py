"""What happens to a rig of servos when something breaks: outcome, sentence, and whether it works again afterwards."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.errors import BadConfig, MoveRefused, RigError
from viewsep.interfaces import JointLimits
from viewsep.sim.clock import PacedClock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.motion import EmulatedMotion
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.servo import EmulatedServo

TILT = ServoSettings(JointLimits("tilt", -1.0, 1.0, 1.0), 1, "XL430-W250")
PAN = ServoSettings(JointLimits("pan", -math.inf, math.inf, 1.0), 2, "XL430-W250", extended=True)
SETTINGS = BusSettings("", (TILT, PAN), baud=1_000_000)
FAR = (0.8, 2.0)


class Bench:
    """A motion on emulated servos in real time, and what a test does with it."""

    def __init__(self, motion: EmulatedMotion, clock: PacedClock) -> None:
        self.motion, self.clock = motion, clock

    def servo(self, servo_id: int) -> EmulatedServo:
        return self.motion.bus[servo_id]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now_ns() + round(seconds * 1e9))

    def until(self, happens: Callable[[], bool], timeout_s: float = 5.0) -> float:
        """How long it took."""
        began_ns = self.clock.now_ns()
        while not happens():
            assert self.clock.now_ns() - began_ns < timeout_s * 1e9, f"waited in vain; fault: {self.motion.fault()!r}"
            self.wait(0.01)
        return (self.clock.now_ns() - began_ns) * 1e-9

    def faulty(self, sentence: str) -> None:
        self.until(lambda: bool(self.motion.fault()))
        assert re.search(sentence, self.motion.fault()), self.motion.fault()
        assert self.motion.fault().endswith("; then clear the fault")
        with pytest.raises(MoveRefused, match=re.escape(self.motion.fault())):
            self.motion.move_to((0.0, 0.0))

    def stands_still(self, servo_id: int, within_s: float = 2.0) -> None:
        def still() -> bool:
            before = self.servo(servo_id).counts
            self.wait(0.1)
            return self.servo(servo_id).counts == before

        self.until(still, within_s)

    def works(self) -> None:
        """It moves and arrives."""
        commanded = self.motion.move_to((0.2, -0.3))
        self.until(lambda: not self.motion.read_state().moving, 10.0)
        np.testing.assert_allclose(self.motion.read_state().position_rad, commanded, atol=0.005)
        assert self.motion.fault() == ""


@pytest.fixture
def bench() -> Iterator[Bench]:
    clock = PacedClock(1.0)
    bench = Bench(EmulatedMotion(SETTINGS, clock), clock)
    bench.motion.connect()
    yield bench
    with suppress(RigError):
        bench.motion.close()


def test_unplugged_in_the_middle_of_a_move(bench: Bench) -> None:
    bench.motion.move_to(FAR)
    bench.wait(0.3)
    bench.motion.port.unplug()
    bench.faulty(r"the serial port .* is gone: plug the adapter in again")
    with pytest.raises(RigError, match="is gone"):
        bench.motion.read_state()
    bench.until(lambda: bench.servo(2)["Bus Watchdog"] == -1)  # nobody speaks to it
    for servo_id in (1, 2):
        bench.stands_still(servo_id)
    with pytest.raises(RigError, match="there is no serial port"):
        bench.motion.clear_fault()
    assert "there is no serial port" in bench.motion.fault()
    bench.motion.port.plug()
    bench.motion.clear_fault()
    bench.works()


def test_overloaded_in_the_middle_of_a_move(bench: Bench) -> None:
    bench.motion.move_to(FAR)
    bench.wait(0.3)
    bench.servo(1).overload()
    bench.faulty(r"servo 1 \(joint 'tilt'\): it was overloaded: remove what blocks the joint")
    assert bench.servo(1)["Torque Enable"] == 0
    bench.stands_still(2)
    assert bench.motion.read_state().fault == bench.motion.fault()
    assert abs(bench.motion.read_state().position_rad[1] - FAR[1]) > 0.5
    bench.motion.clear_fault()
    assert bench.servo(1)["Hardware Error Status"] == 0
    assert bench.servo(1)["Profile Velocity"] > 0  # set again after the servo was started anew
    bench.works()


def test_a_hot_servo(bench: Bench) -> None:
    bench.servo(2).temperature_c = 75
    bench.faulty(r"servo 2 \(joint 'pan'\)( has 75 degC, more than 72|: it is too hot): let it cool down|too hot")
    assert bench.motion.temperatures_c()[1] == 75.0
    with pytest.raises(RigError, match=r"too hot.*was started anew, which did not help"):
        bench.motion.clear_fault()
    assert "too hot" in bench.motion.fault()
    bench.servo(2).temperature_c = 40
    bench.motion.clear_fault()
    bench.works()


def test_too_little_voltage(bench: Bench) -> None:
    bench.servo(1).voltage_v = 5.0
    bench.faulty(r"servo 1 .*(voltage is out of range|has 5.0 V instead of 6.0 to 14.0 V).*check the supply")
    bench.servo(1).voltage_v = 12.0
    bench.motion.clear_fault()
    bench.works()


def test_blocked_by_something(bench: Bench) -> None:
    bench.motion.move_to(FAR)
    bench.wait(0.2)
    bench.servo(1).stuck = True
    bench.faulty(r"servo 1 .*(overloaded: remove what blocks|did not arrive in time.*remove what blocks)")
    bench.stands_still(2)
    bench.servo(1).stuck = False
    bench.motion.clear_fault()
    bench.works()


def test_a_joint_that_does_not_arrive_in_time(bench: Bench) -> None:
    bench.servo(2).poke("Profile Velocity", 1)  # somebody else has set it
    bench.motion.move_to((0.0, 0.5))
    bench.faulty(r"servo 2 \(joint 'pan'\) did not arrive in time: it is \d+\.\d deg away from its set-point")
    bench.motion.clear_fault()
    bench.works()


def test_a_cable_out_of_one_servo(bench: Bench) -> None:
    bench.motion.move_to(FAR)
    bench.wait(0.3)
    bench.servo(2).silent = True
    bench.faulty(r"servo 2 \(joint 'pan'\) has not answered for \d\.\d s: check cable and power")
    for servo_id in (1, 2):
        bench.stands_still(servo_id)
    with pytest.raises(RigError, match=r"servo 2 \(joint 'pan'\) does not answer"):
        bench.motion.clear_fault()
    bench.servo(2).silent = False
    bench.motion.clear_fault()
    bench.works()


def test_closing_with_a_silent_servo_stops_the_others_and_then_tells(bench: Bench) -> None:
    bench.motion.move_to(FAR)
    bench.wait(0.2)
    bench.servo(1).silent = True
    with pytest.raises(RigError, match="servo 1"):
        bench.motion.close()
    goal, position = bench.servo(2)["Goal Position"], bench.servo(2).counts
    assert abs(goal - position) < 100
    assert bench.servo(2)["Bus Watchdog"] == 0


def test_stopped_by_its_watchdog(bench: Bench) -> None:
    """As when the machine stalls: the servo hears nothing though the process lives."""
    bench.servo(1).poke("Bus Watchdog", -1)
    bench.faulty(r"servo 1 .* was stopped by its watchdog")
    bench.motion.clear_fault()
    bench.works()


def test_straining_beyond_the_limit_of_the_settings() -> None:
    clock = PacedClock(1.0)
    servos = (replace(TILT, effort_limit=0.3), PAN)
    bench = Bench(EmulatedMotion(replace(SETTINGS, servos=servos), clock), clock)
    bench.motion.connect()
    bench.works()
    bench.servo(1).load = 0.5
    bench.faulty(r"servo 1 .* strains: 0\.\d+ of full, more than effort_limit = 0.3")
    bench.motion.close()


@pytest.mark.parametrize("release", [False, True])
def test_stopping_holds_or_lets_go(release: bool) -> None:
    clock = PacedClock(1.0)
    bench = Bench(EmulatedMotion(replace(SETTINGS, release=release), clock), clock)
    bench.motion.connect()
    bench.motion.move_to(FAR)
    bench.wait(0.2)
    bench.motion.stop()
    bench.wait(0.3)
    assert [bench.servo(i)["Torque Enable"] for i in (1, 2)] == [int(not release)] * 2
    bench.works()
    bench.motion.close()
    assert [bench.servo(i)["Torque Enable"] for i in (1, 2)] == [int(not release)] * 2


def test_a_reboot_does_not_lose_whole_turns(bench: Bench) -> None:
    bench.servo(2).poke("Profile Velocity", 200)
    bench.motion.move_to((0.0, 7.0))
    bench.until(lambda: not bench.motion.read_state().moving, 15.0)
    before = bench.motion.read_state().position_rad[1]
    bench.servo(2).overload()
    bench.faulty("overloaded")
    bench.motion.clear_fault()
    assert bench.servo(2).counts < 4096
    assert bench.motion.read_state().position_rad[1] == pytest.approx(before, abs=0.01)
    commanded = bench.motion.move_to((0.0, 6.5))
    bench.until(lambda: not bench.motion.read_state().moving, 10.0)
    assert bench.motion.read_state().position_rad == pytest.approx(commanded, abs=0.005)


def refused(settings: BusSettings, *servos: EmulatedServo, prepare: Callable[[EmulatedBus], None] | None = None) -> str:
    """Why a rig cannot be connected to; its port is free again afterwards."""
    bus = EmulatedBus(servos)
    if prepare:
        prepare(bus)
    with EmulatedPort(bus) as port:
        for _ in range(2):
            with pytest.raises(RigError) as caught:
                DynamixelMotion(replace(settings, port=port.name), MonotonicClock()).connect()
    return str(caught.value)


def servo(servo_id: int, model: str = "XL430-W250") -> EmulatedServo:
    return EmulatedServo(servo_id, model, clock=MonotonicClock(), baud=1_000_000)


def test_servos_that_are_missing_wrong_or_unexpected_are_listed() -> None:
    told = refused(SETTINGS, servo(2, "XM430-W350"), servo(7))
    assert "servo 1 (joint 'tilt') does not answer" in told
    assert "servo 2 (joint 'pan') is a XM430-W350, not a XL430-W250" in told
    assert "unexpected: XL430-W250 with id 7" in told
    assert told.endswith("check power, cables, ids and baud with `viewsep rig scan`")


def test_limits_of_the_servo_must_allow_the_rigs() -> None:
    def narrow(bus: EmulatedBus) -> None:
        bus[1].poke("Max Position Limit", 2300)

    told = refused(SETTINGS, servo(1), servo(2), prepare=narrow)
    assert re.search(r"servo 1 \(joint 'tilt'\): .* Min and Max Position Limit are 0 and 2300: narrow the rig's", told)


def test_speeds_above_the_servos_limit_are_refused() -> None:
    fast = replace(PAN, joint=replace(PAN.joint, max_speed_rad_s=20.0))
    told = refused(replace(SETTINGS, servos=(TILT, fast)), servo(1), servo(2))
    assert "max_speed_deg_s = 1145.92 is above the servo's Velocity Limit of 364 deg/s: lower it" in told


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (replace(TILT, servo_id=2), r"joint 'tilt': id = 2 is given twice"),
        (replace(TILT, model="XL999"), r"joint 'tilt': model = 'XL999' is unknown: choose one of .*XL430-W250"),
        (replace(TILT, zero_counts=100), r"joint 'tilt': mode = 'position' reaches 0 to 4095 counts, but its limits"),
        (replace(PAN, servo_id=1, extended=False), r"joint 'pan': mode = 'position' reaches .* use mode = 'extended'"),
    ],
)
def test_settings_that_cannot_be_are_refused_at_once(wrong: ServoSettings, sentence: str) -> None:
    with pytest.raises(BadConfig, match=sentence):
        DynamixelMotion(replace(SETTINGS, servos=(wrong, PAN)), MonotonicClock())


MOVER = """
import sys, time
from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.motion import DynamixelMotion
sys.path.insert(0, sys.argv[2])
from test_servo_faults import SETTINGS
from dataclasses import replace
motion = DynamixelMotion(replace(SETTINGS, port=sys.argv[1]), MonotonicClock())
motion.connect()
motion.move_to((0.0, 60.0))
print("moving", flush=True)
time.sleep(60)
"""


def test_killed_in_the_middle_of_a_move() -> None:
    """Nothing in the process can act any more: the servos' watchdogs do."""
    bus = EmulatedBus([servo(1), servo(2)])
    with EmulatedPort(bus) as port:
        arguments = [sys.executable, "-c", MOVER, port.name, __file__.rpartition("/")[0]]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "moving\n"
            clock = MonotonicClock()
            clock.sleep_until(clock.now_ns() + 300_000_000)
            process.send_signal(signal.SIGKILL)
            process.wait(10.0)
            killed_ns = clock.now_ns()
            while bus[2]["Bus Watchdog"] != -1:
                assert clock.now_ns() - killed_ns < 2e9
                clock.sleep_until(clock.now_ns() + 10_000_000)
            stopped = bus[2].counts
            clock.sleep_until(clock.now_ns() + 200_000_000)
            assert bus[2].counts == stopped
            motion = DynamixelMotion(replace(SETTINGS, port=port.name), clock)
            motion.connect()  # the port is free, the watchdog cleared
            assert motion.fault() == ""
            motion.close()
