"""From configuration to servos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.config import Config, ServoConfig, geometry_of
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.errors import BadConfig, Timeout
from viewsep.interfaces import Clock, JointLimits, MotionBackend
from viewsep.perception import position_at
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.dynamixel.motion import EmulatedMotion
from viewsep.sim.followed import JointsAt

EMULATED = "emulated"
FOLLOW_S, POLL_NS = 0.5, 5_000_000  # how long a simulated camera waits for the read-back after a moment


def servo_motion(config: Config) -> tuple[DynamixelMotion, SimClock, JointsAt]:
    """The servos, real or emulated, their clock, and where their joints are at a moment. Raises BadConfig.

    Of emulated servos the truth is known; of real ones the read-backs.
    """
    clock = PacedClock(config.dynamixel.emulated_speed if is_emulated(config) else 1.0)
    motion = joint_motion(config, clock)
    return motion, clock, motion.joints_at if isinstance(motion, EmulatedMotion) else read_backs(motion, clock)


def joint_motion(config: Config, clock: Clock) -> DynamixelMotion:
    """The servos, real or emulated, on a clock. Raises BadConfig."""
    settings = bus_settings(config)
    if is_emulated(config):
        return EmulatedMotion(settings, clock, float(np.radians(config.sim.backlash_deg)))
    return DynamixelMotion(settings, clock)


def is_emulated(config: Config) -> bool:
    """Whether the servos need no hardware."""
    return config.dynamixel.port == EMULATED


def read_backs(motion: MotionBackend, clock: SimClock) -> JointsAt:
    """Joint angles at a moment as the encoders say, waiting for the reading after it."""

    def joints_at(stamp_ns: int) -> Sequence[float]:
        deadline_ns = clock.now_ns() + round(FOLLOW_S * 1e9)
        while True:
            history = motion.history(stamp_ns)
            try:
                angles: list[float] = position_at(stamp_ns, history).tolist()
                return angles
            except Timeout:
                if clock.now_ns() > deadline_ns:
                    raise
            clock.sleep_until(clock.now_ns() + POLL_NS)

    return joints_at


def hardware_settings(config: Config, origin: str) -> BusSettings:
    """The settings of servos that are there. Raises BadConfig for a rig that has none."""
    if config.rig.backend != "dynamixel":
        raise BadConfig(
            f"{origin}: rig.backend = {config.rig.backend!r} has no servos: `viewsep rig init` writes a configuration"
        )
    if is_emulated(config):
        raise BadConfig(
            f"{origin}: dynamixel.port = 'emulated': there is nothing to set up; give the servos' port, or that which "
            "`viewsep rig emulate` prints"
        )
    return bus_settings(config)


def bus_settings(config: Config) -> BusSettings:
    """What the servos of a rig are set up with. Raises BadConfig."""
    given, joints = config.dynamixel, geometry_of(config.rig).limits
    settings = BusSettings(
        port=given.port,
        servos=tuple(_servo_settings(servo, joint) for servo, joint in zip(given.servos, joints, strict=True)),
        baud=given.baud,
        retries=given.retries,
        state_hz=given.state_hz,
        watchdog_s=given.watchdog_s,
        release=given.when_stopped == "release",
        tolerance_rad=float(np.radians(given.settle_within_deg)),
        lost_s=given.lost_s,
    )
    settings.check()
    return settings


def _servo_settings(given: ServoConfig, joint: JointLimits) -> ServoSettings:
    return ServoSettings(
        joint=joint,
        servo_id=given.id,
        extended=given.mode == "extended",
        acceleration_rad_s2=float(np.radians(given.acceleration_deg_s2)),
        **given.model_dump(exclude={"joint", "id", "mode", "acceleration_deg_s2"}),
    )
