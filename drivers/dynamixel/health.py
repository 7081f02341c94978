"""Watches what a servo feels: effort, temperature, voltage, hardware errors, and whether its watchdog stopped it."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.drivers.dynamixel.registers import Registers
from viewsep.drivers.dynamixel.servo import WATCHDOG_STOPPED, Servo
from viewsep.drivers.dynamixel.settings import ServoSettings

EFFORT_NS = 300_000_000  # effort above the limit for less than this is a start or a stop


@dataclass(frozen=True, slots=True)
class HealthLimits:
    """What a servo may feel: the settings' limits, and where those have none its own."""

    hottest_c: float
    lowest_v: float
    highest_v: float

    @classmethod
    def of(cls, servo: Registers, wanted: ServoSettings | None) -> HealthLimits:
        """Raises BusError when the servo's limits cannot be read."""
        return cls(
            (wanted and wanted.temperature_limit_c) or servo.read_si("Temperature Limit"),
            (wanted and wanted.min_voltage_v) or servo.read_si("Min Voltage Limit"),
            (wanted and wanted.max_voltage_v) or servo.read_si("Max Voltage Limit"),
        )


class Health:
    """One servo's. Complaints are sentences, empty when all is well."""

    def __init__(self, servo: Servo) -> None:
        """Raises BusError when the servo's limits cannot be read."""
        self.temperature_c: float | None = None
        self._servo = servo
        self._limits = HealthLimits.of(servo, servo.settings)
        self._strained_since_ns: int | None = None

    def feel(self, effort: float, stamp_ns: int) -> str:
        """What is wrong with the current (A) or load (share of full) of one reading and those before."""
        limit = self._servo.settings.effort_limit
        if limit is None or abs(effort) <= limit:
            self._strained_since_ns = None
            return ""
        if self._strained_since_ns is None:
            self._strained_since_ns = stamp_ns
        if stamp_ns - self._strained_since_ns < EFFORT_NS:
            return ""
        unit = self._servo.table[self._servo.effort].unit
        return (
            f"{self._servo.name} strains: {abs(effort):.2f} {unit}, more than effort_limit = {limit:g}: remove what "
            "blocks the joint, or raise the limit"
        )

    def look(self) -> str:
        """Read temperature, voltage and errors. Raises BusError."""
        servo, limits = self._servo, self._limits
        self.temperature_c = servo.read_si("Present Temperature")
        volts = servo.read_si("Present Input Voltage")
        if alert := servo.alert():
            return f"{servo.name}: {alert}"
        if self.temperature_c > limits.hottest_c:
            return f"{servo.name} has {self.temperature_c:.0f} degC, more than {limits.hottest_c:.0f}: let it cool down"
        if not limits.lowest_v <= volts <= limits.highest_v:
            allowed = f"{limits.lowest_v:.1f} to {limits.highest_v:.1f} V"
            return f"{servo.name} has {volts:.1f} V instead of {allowed}: check the supply and the cables"
        if servo.read("Bus Watchdog") == WATCHDOG_STOPPED:
            return f"{servo.name} was stopped by its watchdog, since it heard nothing for too long: the machine stalled"
        return ""
