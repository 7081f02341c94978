"""Joints turned by emulated servos: the motion driver, a pseudo-terminal, and the servos behind it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

from viewsep.drivers.dynamixel.control_table import STEP_RAD
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.interfaces import Clock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.presets import MODEL
from viewsep.sim.dynamixel.servo import EmulatedServo

_numbers = count()


class EmulatedMotion(DynamixelMotion):
    """`MotionBackend` that needs no hardware: servos as the settings describe them, at zero or the limit nearest to it.

    `backlash_rad` is the play of every joint. `bus` is there for tests and for whoever wants to know the truth.
    """

    def __init__(self, settings: BusSettings, clock: Clock, backlash_rad: float = 0.0) -> None:
        link = Path(tempfile.gettempdir()) / f"viewsep-servos-{os.getpid()}-{next(_numbers)}"
        super().__init__(replace(settings, port=str(link)), clock)
        self._emulated = settings.servos
        self._link = link
        self._port: EmulatedPort | None = None
        self.bus = EmulatedBus([_emulated(servo, settings.baud, clock, backlash_rad) for servo in settings.servos])

    @property
    def port(self) -> EmulatedPort:
        """The terminal, from `connect` to `close`."""
        assert self._port is not None
        return self._port

    def connect(self) -> None:
        """Make the terminal and connect to it. Raises RigError."""
        if self._port is None:
            self._port = EmulatedPort(self.bus, self._link)
        try:
            super().connect()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop, and take the terminal away."""
        port, self._port = self._port, None
        try:
            super().close()
        finally:
            if port is not None:
                port.close()

    def joints_at(self, stamp_ns: int) -> Sequence[float]:
        """The true angles of the joints, behind their play, at a moment of the last 30 s."""
        servos = zip(self._emulated, self.bus.servos, strict=True)
        return [wanted.angle_rad(servo.joint_rad_at(stamp_ns) / STEP_RAD) for wanted, servo in servos]


def _emulated(wanted: ServoSettings, baud: int, clock: Clock, backlash_rad: float) -> EmulatedServo:
    home = min(max(0.0, wanted.joint.lower_rad), wanted.joint.upper_rad)
    return EmulatedServo(
        wanted.servo_id,
        wanted.model or MODEL,
        clock=clock,
        baud=baud,
        backlash_rad=backlash_rad * wanted.gear_ratio,
        position=wanted.counts(home),
    )
