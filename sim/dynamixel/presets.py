"""Emulated buses for the rigs that viewsep knows."""

from __future__ import annotations

from types import MappingProxyType

from viewsep.errors import RigError
from viewsep.interfaces import Clock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.servo import EmulatedServo

MODEL = "XL430-W250"
PRESETS = MappingProxyType({"turntable": (1,), "pan_tilt": (1, 2), "wrist": (1, 2, 3)})
"""Servo ids, from the base to the object."""


def emulated_bus(preset: str, clock: Clock, baud: int = 57600, backlash_rad: float = 0.0) -> EmulatedBus:
    """Servos as they leave the factory, at the count 2048. Raises RigError for a preset there is not."""
    if preset not in PRESETS:
        raise RigError(f"no emulated servos for the preset {preset!r}: use one of {', '.join(PRESETS)}")
    ids = PRESETS[preset]
    return EmulatedBus([EmulatedServo(i, MODEL, clock=clock, baud=baud, backlash_rad=backlash_rad) for i in ids])
