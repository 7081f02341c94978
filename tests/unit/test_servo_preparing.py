"""A servo is brought into its state without a jerk, and knows where its joint is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.servo import Reading, Servo, handshake
from viewsep.drivers.dynamixel.settings import ServoSettings
from viewsep.errors import RigError
from viewsep.interfaces import JointLimits
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.servo import EmulatedServo

TILT = ServoSettings(JointLimits("tilt", -1.0, 1.0, 1.0), 1)
YAW = ServoSettings(JointLimits("yaw", math.radians(-170), math.radians(170), 1.0), 1, extended=True, zero_counts=9000)
PAN = ServoSettings(JointLimits("pan", -math.inf, math.inf, 1.0), 1, extended=True)


@contextmanager
def connected(settings: ServoSettings, position: float, sent: list[bytes]) -> Iterator[tuple[Servo, EmulatedServo]]:
    emulated = EmulatedServo(1, clock=MonotonicClock(), baud=1_000_000, position=position)
    with EmulatedPort(EmulatedBus([emulated])) as port:
        bus = Bus(port.name, 1_000_000, trace=lambda way, data: sent.append(data) if way == ">" else None)
        bus.open()
        try:
            yield handshake(bus, (settings,))[0], emulated
        finally:
            bus.close()


@pytest.mark.parametrize("settings", [TILT, PAN])
def test_its_goal_is_where_it_is_before_the_torque_is_on(settings: ServoSettings) -> None:
    """Real servos keep an old goal while the torque is off."""
    sent: list[bytes] = []
    with connected(settings, 2300, sent) as (servo, emulated):
        servo.prepare()
        assert (emulated["Torque Enable"], emulated["Goal Position"], emulated.counts) == (1, 2300, 2300)
    writes = [packet[8:-2] for packet in sent if packet[7] == 0x03]
    goal, torque = bytes([116, 0, 0xFC, 0x08, 0, 0]), bytes([64, 0, 1])
    assert writes.index(goal) < writes.index(torque)


def test_beyond_its_own_limits_it_gets_no_torque() -> None:
    with connected(TILT, 3900, []) as (servo, emulated):
        emulated.poke("Max Position Limit", 3000)
        with pytest.raises(RigError, match=r"servo 1 \(joint 'tilt'\) is at position 3900, beyond its own Min and Max"):
            servo.prepare()
        assert emulated["Torque Enable"] == 0


@pytest.mark.parametrize(("settings", "position"), [(YAW, 9000 % 4096), (YAW, 9000 + 3 * 4096), (PAN, 2048 - 5 * 4096)])
def test_forgotten_turns_are_made_up_for(settings: ServoSettings, position: int) -> None:
    """Without power a servo forgets its turns; a joint of less than a turn is where its limits allow."""
    with connected(settings, 2048, []) as (servo, emulated):
        servo.prepare()
        emulated.poke("Present Position", position)
        servo.count_from(None)
        assert servo.angle_rad(position) == pytest.approx(0.0, abs=1e-9)
        assert servo.goal_counts(0.0) == position


def test_a_joint_beyond_its_limit_stays_there_when_it_is_stopped() -> None:
    with connected(TILT, 2048, []) as (servo, _):
        beyond = 2048 + round(1.3 * 4096 / 2 / math.pi)
        assert servo.braking_goal(Reading(beyond, 0.0, True, 0.0)) == beyond
        assert servo.braking_goal(Reading(beyond, 0.5, False, 0.0)) == beyond
        assert servo.braking_goal(Reading(beyond, -0.5, False, 0.0)) < beyond
        _, highest = TILT.counts_range()
        assert servo.braking_goal(Reading(round(highest) - 2, 0.5, False, 0.0)) == round(highest)
