"""The motion contract on every backend: add one factory per implementation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from motion_contract import MotionCase, MotionContract
from rig_on_zenoh import remote_rig, station

from viewsep.config import Config, JointConfig, RigConfig, geometry_of
from viewsep.drivers.dynamixel.control_table import STEP_RAD
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, RigGeometry, preset, rig_geometry
from viewsep.messages import Array
from viewsep.service.hardware import SharedMotion
from viewsep.service.lease import Lease
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.dynamixel.motion import EmulatedMotion
from viewsep.sim.motion import ENCODER_STEP_RAD, SimMotion
from viewsep.sim.plate import PhotoPlate
from viewsep.sim.world import SimWorld

Make = Callable[[ExitStack], MotionCase]
"""From what must be left at the end to a backend."""


def simulated(name: str, disturbances: Disturbances | None = None) -> Make:
    def make(_stack: ExitStack) -> MotionCase:
        clock = SimClock()
        world = SimWorld(preset(name), clock, 0, disturbances or Disturbances())
        return MotionCase(SimMotion(world), clock, ENCODER_STEP_RAD)

    return make


def plate(geometry: RigGeometry, rests_deg: Array) -> Make:
    """A plate over photos rests only where it shows one: its set-points are rounded to the closest of these."""

    def make(_stack: ExitStack) -> MotionCase:
        clock = SimClock()
        world = PhotoPlate(geometry, clock, Disturbances(), np.radians(rests_deg), 1.0)
        furthest = np.radians(max(np.diff(np.unique(joint)).max() for joint in rests_deg.T))
        return MotionCase(SimMotion(world), clock, furthest + ENCODER_STEP_RAD)

    return make


def shared(speed: float) -> Make:
    """Shared with other threads, in stepped time or in real time that is `speed` times as fast."""

    def make(stack: ExitStack) -> MotionCase:
        clock = PacedClock(speed) if speed else SimClock()
        world = SimWorld(geometry_of(SHORT), clock, 0, Disturbances())
        motion = SharedMotion(SimMotion(world), Lease(60.0))
        stack.callback(motion.close)
        return MotionCase(motion, clock, ENCODER_STEP_RAD)

    return make


def remote(speed: float) -> Make:
    """Driven from the other end of a connection."""

    def make(stack: ExitStack) -> MotionCase:
        here = stack.enter_context(station(Config(rig=SHORT), speed=speed))
        rig = stack.enter_context(remote_rig(here)).lent_to("a contract")
        return MotionCase(rig.motion, rig.clock, ENCODER_STEP_RAD)

    return make


def emulated(name: str, baud: int = 1_000_000) -> Make:
    """The servo driver on emulated servos, in real time that is four times as fast."""

    def make(stack: ExitStack) -> MotionCase:
        clock = PacedClock(4.0)
        servos = tuple(
            ServoSettings(replace(limit, max_speed_rad_s=0.7), number, extended=np.isinf(limit.upper_rad))
            for number, limit in enumerate(preset(name).limits, 1)
        )
        # what counts in the wall's time is given more of the clock's
        motion = EmulatedMotion(BusSettings("", servos, baud, state_hz=60.0, watchdog_s=2.5, lost_s=2.5), clock)
        stack.callback(motion.close)
        return MotionCase(motion, clock, STEP_RAD, np.radians(0.1), stamp_accuracy_s=0.02)

    return make


# short ways, since some of these take real time
SHORT = RigConfig(
    joints=(
        JointConfig(name="tilt", axis=(0, 1, 0), lower_deg=-30, upper_deg=30, max_speed_deg_s=20),
        JointConfig(name="pan", axis=(0, 0, 1), lower_deg=-30, upper_deg=40, max_speed_deg_s=20),
    )
)
TILT_AND_PAN = rig_geometry(
    "photos",
    [[0, 1, 0], [0, 0, 1]],
    [JointLimits("tilt", 0.0, np.radians(60.0), 0.35), JointLimits("pan", -np.inf, np.inf, 0.35)],
    0.0,
)
RING = np.arange(0.0, 360.0, 5.0)[:, None]
GRID = np.array([(tilt, pan) for tilt in (0.0, 20.0, 40.0, 60.0) for pan in np.arange(0.0, 360.0, 7.5)])
IMPLEMENTATIONS: dict[str, Make] = {
    **{f"simulated {name}": simulated(name) for name in PRESETS},
    "simulated gimbal with play": simulated("gimbal", Disturbances(backlash_deg=2.0)),
    "photos on a ring": plate(preset("turntable"), RING),
    "photos on a ring with holes": plate(preset("turntable"), RING[np.arange(72) % 5 > 0]),
    "photos on four rings": plate(TILT_AND_PAN, GRID),
    "shared, stepped": shared(0.0),
    "shared, real time": shared(10.0),
    "remote, stepped": remote(0.0),
    **{f"emulated servos: {name}": emulated(name) for name in ("turntable", "pan_tilt", "wrist")},
}


def marked(name: str) -> pytest.ParameterSet:
    if name.startswith("emulated"):  # their time is the wall's, a multiple of it
        marks = [pytest.mark.alone] if name.endswith("wrist") else [pytest.mark.alone, pytest.mark.long]
    else:
        marks = [] if name.startswith("photos") else [pytest.mark.needs_pybullet]
    return pytest.param(IMPLEMENTATIONS[name], marks=marks, id=name)


@pytest.fixture(params=[marked(name) for name in IMPLEMENTATIONS])
def case(request: pytest.FixtureRequest) -> Iterator[MotionCase]:
    with ExitStack() as stack:
        yield request.param(stack)


class TestMotion(MotionContract):
    pass
