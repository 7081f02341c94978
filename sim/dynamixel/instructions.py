"""What one servo does with one instruction packet addressed to it."""

from __future__ import annotations

from collections.abc import Callable

from viewsep.sim.dynamixel.packets import ALERT, BROADCAST, Code, Error, Instruction, Status
from viewsep.sim.dynamixel.registers import Refused
from viewsep.sim.dynamixel.servo import EmulatedServo

CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"
BACK_UP, RESTORE = b"\x01CTRL", b"\x02CTRL"
RESET_ALL = 0xFF


class Obedience:
    """Carries out instructions on a servo and words the answer; remembers what was registered for Action."""

    def __init__(self, servo: EmulatedServo) -> None:
        self.servo = servo
        self._registered: tuple[int, bytes] | None = None
        self._backup: bytes | None = None
        self._does: dict[int, Callable[[bytes, int], bytes]] = {
            Code.PING: self._ping,
            Code.READ: self._read,
            Code.WRITE: self._write,
            Code.REG_WRITE: self._register,
            Code.ACTION: self._act,
            Code.FACTORY_RESET: self._reset,
            Code.REBOOT: self._reboot,
            Code.CLEAR: self._clear,
            Code.CONTROL_TABLE_BACKUP: self._back_up,
        }

    def means_me(self, packet_id: int) -> bool:
        """Whether the id is the servo's first or second one, or everybody's."""
        ids = self.servo.registers
        return packet_id in (ids["ID"], ids["Secondary(Shadow) ID"], BROADCAST)

    def obey(self, packet: Instruction, now_ns: int) -> Status | None:
        """Do it. None where the servo keeps silent: told to all, by its second id, or by its Status Return Level."""
        servo_id = self.servo.registers["ID"]
        to_all = packet.id == BROADCAST
        if to_all and (packet.code == Code.READ or (packet.code, packet.params) == (Code.FACTORY_RESET, b"\xff")):
            return None
        level = self.servo.registers["Status Return Level"]
        try:
            does = self._does.get(packet.code)
            if does is None:
                raise Refused(Error.INSTRUCTION)
            status = self.status(servo_id, does(packet.params, now_ns))
        except Refused as refusal:
            status = self.status(servo_id, error=refusal.error)
        if packet.code == Code.PING:
            return status
        loud = level == 2 or (level == 1 and packet.code == Code.READ)
        return status if loud and packet.id == servo_id else None

    def read_for_group(self, address: int, length: int) -> Status | None:
        """The servo's part of a Sync or Bulk Read."""
        registers = self.servo.registers
        if registers["Status Return Level"] == 0:
            return None
        try:
            return self.status(registers["ID"], registers.read(address, length))
        except Refused as refusal:
            return self.status(registers["ID"], error=refusal.error)

    def write_for_group(self, address: int, data: bytes, now_ns: int) -> None:
        """The servo's part of a Sync or Bulk Write: nobody hears of a refusal."""
        try:
            self.servo.write(address, data, now_ns)
        except Refused:
            return

    def status(self, servo_id: int, params: bytes = b"", error: int = 0) -> Status:
        """An answer, with the alert bit where something is wrong."""
        alert = ALERT if self.servo.registers["Hardware Error Status"] else 0
        return Status(servo_id, error | alert, params)

    def _ping(self, _params: bytes, _now_ns: int) -> bytes:
        registers = self.servo.registers
        return registers["Model Number"].to_bytes(2, "little") + bytes((registers["Firmware Version"],))

    def _read(self, params: bytes, _now_ns: int) -> bytes:
        if len(params) != 4:
            raise Refused(Error.DATA_LENGTH)
        return self.servo.registers.read(*words(params))

    def _write(self, params: bytes, now_ns: int) -> bytes:
        self.servo.write(*_addressed(params), now_ns)
        return b""

    def _register(self, params: bytes, _now_ns: int) -> bytes:
        address, data = _addressed(params)
        self.servo.checked(address, data)
        self._registered = address, data
        self.servo.registers["Registered Instruction"] = 1
        return b""

    def _act(self, _params: bytes, now_ns: int) -> bytes:
        if self._registered is None:
            raise Refused(Error.INSTRUCTION)
        registered, self._registered = self._registered, None
        self.servo.registers["Registered Instruction"] = 0
        self.servo.write(*registered, now_ns)
        return b""

    def _reset(self, params: bytes, now_ns: int) -> bytes:
        if len(params) != 1:
            raise Refused(Error.DATA_LENGTH)
        self.servo.registers.factory_reset(params[0])
        return self._reboot(b"", now_ns)

    def _reboot(self, _params: bytes, now_ns: int) -> bytes:
        self._registered = None
        self.servo.reboot(now_ns)
        return b""

    def _clear(self, params: bytes, now_ns: int) -> bytes:
        if params != CLEAR_TURNS:
            raise Refused(Error.DATA_RANGE)
        self.servo.forget_turns(now_ns)
        return b""

    def _back_up(self, params: bytes, now_ns: int) -> bytes:
        if params not in (BACK_UP, RESTORE):
            raise Refused(Error.DATA_RANGE)
        if self.servo.torque or (params == RESTORE and self._backup is None):
            raise Refused(Error.RESULT_FAIL)
        if params == BACK_UP:
            self._backup = self.servo.registers.eeprom
        elif self._backup is not None:
            self.servo.registers.eeprom = self._backup
            self._reboot(b"", now_ns)
        return b""


def words(params: bytes) -> tuple[int, ...]:
    """Numbers of two bytes each."""
    return tuple(int.from_bytes(params[i : i + 2], "little") for i in range(0, len(params), 2))


def _addressed(params: bytes) -> tuple[int, bytes]:
    if len(params) < 3:
        raise Refused(Error.DATA_LENGTH)
    return words(params[:2])[0], params[2:]
