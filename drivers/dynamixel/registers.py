"""The registers of one servo, by name."""

from __future__ import annotations

from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.control_table import ControlTable


class Registers:
    """What can be read from and written to a servo on a bus. Every call raises BusError."""

    def __init__(self, bus: Bus, servo_id: int, table: ControlTable) -> None:
        self.table = table
        self._bus = bus
        self._servo_id = servo_id

    def read(self, register: str) -> int:
        """A register's counts."""
        return self._bus.read(self._servo_id, self.table[register])

    def read_si(self, register: str) -> float:
        """A register's value in its unit."""
        return self.read(register) * self.table[register].scale

    def write(self, register: str, counts: int) -> None:
        """Set a register."""
        self._bus.write(self._servo_id, self.table[register], counts)
