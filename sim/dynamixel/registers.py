"""The memory of one servo: a control table of bytes with access rules."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from types import MappingProxyType

from viewsep.drivers.dynamixel.control_table import EEPROM_END, ControlTable, Register
from viewsep.sim.dynamixel.models import DRIVE_MODES, GOALS, READ_ONLY, indirect_blocks, value_range
from viewsep.sim.dynamixel.packets import Error

WATCHDOG_TRIPPED = -1
_KEPT_BY_RESET = {0xFF: (), 0x01: ("ID",), 0x02: ("ID", "Baud Rate")}


class Refused(Exception):
    """An instruction cannot be carried out; `error` goes into the status."""

    def __init__(self, error: Error) -> None:
        super().__init__(error.name)
        self.error = error


class Registers:
    """Named access for the servo itself, checked access for what comes over the bus.

    The e-manual leaves open what reading a gap between registers gives: here a read has to begin and end at defined
    bytes, and gaps within read as 0.
    """

    def __init__(self, table: ControlTable, factory: MappingProxyType[str, int]) -> None:
        self._factory = factory
        pointers, data = zip(*_indirect(table), strict=True)
        plain = (register for name, register in table.registers.items() if not name.startswith("Indirect"))
        self._registers: dict[str, Register] = {register.name: register for register in (*plain, *pointers, *data)}
        self._at = {register.address: register for register in self._registers.values()}
        self._pointers = {d.address: p.address for p, d in zip(pointers, data, strict=True)}
        self._defined = {a for register in self._at.values() for a in range(register.address, register.end)}
        self._memory = bytearray(max(self._defined) + 1)
        for name, value in factory.items():
            if name in self:
                self[name] = value
        self.forget_ram()

    def __contains__(self, name: str) -> bool:
        return name in self._registers

    def __getitem__(self, name: str) -> int:
        register = self._registers[name]
        return register.decode(bytes(self._memory[register.address : register.end]))

    def __setitem__(self, name: str, value: int) -> None:
        register = self._registers[name]
        self._memory[register.address : register.end] = register.encode(value)

    @property
    def eeprom(self) -> bytes:
        """What outlives power."""
        return bytes(self._memory[:EEPROM_END])

    @eeprom.setter
    def eeprom(self, memory: bytes) -> None:
        self._memory[:EEPROM_END] = memory

    def forget_ram(self) -> None:
        """What a reboot does: the EEPROM stays."""
        self._memory[EEPROM_END:] = bytes(len(self._memory) - EEPROM_END)
        for name, value in self._factory.items():
            if name in self._registers and not self._registers[name].in_eeprom:
                self[name] = value
        for data, pointer in self._pointers.items():
            self._memory[pointer : pointer + 2] = data.to_bytes(2, "little")

    def factory_reset(self, option: int) -> None:
        """All but what `option` keeps. Raises Refused for an unknown option."""
        if option not in _KEPT_BY_RESET:
            raise Refused(Error.DATA_RANGE)
        kept = {name: self[name] for name in _KEPT_BY_RESET[option]}
        for name, register in self._registers.items():
            if register.in_eeprom and name not in READ_ONLY:
                self[name] = kept.get(name, self._factory.get(name, 0))
        self.forget_ram()

    def read(self, address: int, length: int) -> bytes:
        """Bytes as the bus sees them. Raises Refused."""
        if not length or address not in self._defined or address + length - 1 not in self._defined:
            raise Refused(Error.ACCESS)
        if not any(a in self._pointers for a in range(address, address + length)):
            return bytes(self._memory[address : address + length])
        return bytes(self._memory[self._resolved(a)] for a in range(address, address + length))

    def check(self, address: int, data: bytes) -> list[tuple[str, int]]:
        """The registers and values a write from the bus means, all of them allowed ones. Raises Refused."""
        if not data:
            raise Refused(Error.DATA_LENGTH)
        return [write for start, part in self._runs(address, data) for write in self._check_run(start, part)]

    def _check_run(self, address: int, data: bytes) -> Iterable[tuple[str, int]]:
        while data:
            register = self._at.get(address)
            if register is None:
                raise Refused(Error.DATA_LENGTH if address in self._defined else Error.ACCESS)
            if register.size > len(data):
                raise Refused(Error.DATA_LENGTH)
            yield self._checked(register, data[: register.size])
            address, data = register.end, data[register.size :]

    def _checked(self, register: Register, data: bytes) -> tuple[str, int]:
        name, value = register.name, register.decode(data)
        if name in READ_ONLY or (register.in_eeprom and self["Torque Enable"]):
            raise Refused(Error.ACCESS)
        if self["Bus Watchdog"] == WATCHDOG_TRIPPED and (name in GOALS or (name == "Bus Watchdog" and value)):
            raise Refused(Error.DATA_RANGE)
        limits = value_range(name, self._factory)
        if limits and not limits[0] <= value <= limits[1]:
            raise Refused(Error.DATA_RANGE)
        if name == "Drive Mode" and value not in DRIVE_MODES:
            raise Refused(Error.DATA_RANGE)
        if name == "Operating Mode" and value not in ((0, 1, 3, 4, 5, 16) if "Goal Current" in self else (1, 3, 4, 16)):
            raise Refused(Error.DATA_RANGE)
        if name == "Secondary(Shadow) ID" and value in (253, 254):
            raise Refused(Error.DATA_RANGE)
        if name.startswith("Indirect Address") and not (value >= EEPROM_END and value in self._defined):
            raise Refused(Error.DATA_RANGE)
        return name, value

    def _resolved(self, address: int) -> int:
        pointer = self._pointers.get(address)
        return address if pointer is None else int.from_bytes(self._memory[pointer : pointer + 2], "little")

    def _runs(self, address: int, data: bytes) -> Iterable[tuple[int, bytes]]:
        """Where the bytes go: runs of neighbouring addresses, indirect ones followed."""
        targets = [self._resolved(a) for a in range(address, address + len(data))]
        starts = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(targets)) if b != a + 1), len(data)]
        for start, end in pairwise(starts):
            yield targets[start], data[start:end]


def _indirect(table: ControlTable) -> Iterable[tuple[Register, Register]]:
    """Pointers and the bytes that stand for what they point at."""
    number = 0
    for pointers, data in indirect_blocks(table.model):
        for index in range((data - pointers) // 2):
            number += 1
            yield (
                Register(f"Indirect Address {number}", pointers + 2 * index, 2, signed=False),
                Register(f"Indirect Data {number}", data + index, 1, signed=False),
            )
