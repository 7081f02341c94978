"""Servos on one half-duplex line: bytes in, replies out."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from viewsep.errors import RigError
from viewsep.sim.dynamixel.faults import OF_REPLIES, Fault, FaultScript, Kind
from viewsep.sim.dynamixel.instructions import Obedience, words
from viewsep.sim.dynamixel.packets import (
    BROADCAST,
    HEADER,
    BadCrc,
    Code,
    Error,
    Instruction,
    Parser,
    Status,
    crc16,
    encode,
)
from viewsep.sim.dynamixel.servo import OVERLOAD_ALERT, EmulatedServo

RETURN_DELAY_S = 2e-6  # unit of Return Delay Time
PING_STAGGER_S = 0.002  # between the ids answering a ping to all
GROUP_READS = (Code.SYNC_READ, Code.BULK_READ, Code.FAST_SYNC_READ, Code.FAST_BULK_READ)


@dataclass(frozen=True, slots=True)
class Reply:
    """Bytes that come back `delay_s` after the instruction."""

    delay_s: float
    data: bytes


class EmulatedBus:
    """Servos that share a line. For any number of threads.

    In a group read every servo waits for the one before it: behind a silent one nobody answers. A servo whose Baud Rate
    is not the line's hears noise and keeps silent. Raises RigError when two servos have the same id and baud rate.
    """

    def __init__(self, servos: Sequence[EmulatedServo], seed: int = 0) -> None:
        if not servos:
            raise RigError("an emulated bus needs a servo")
        taken = [(servo.registers["ID"], servo.baud) for servo in servos]
        if len(set(taken)) < len(taken):
            raise RigError(f"two emulated servos have the same id and baud rate: {sorted(taken)}")
        self.servos = tuple(servos)
        self.clock = servos[0].clock
        self.lock = threading.RLock()
        for servo in servos:
            servo.lock = self.lock
        self.faults = BusFaults(self, seed)
        self.unplug: Callable[[], None] = lambda: None  # a port puts its own here
        self._obedient = [Obedience(servo) for servo in servos]
        self._parser = Parser()
        self._baud: int | None = None
        self._does: dict[int, Callable[[bytes, list[Obedience], int], Iterator[Reply]]] = {
            Code.SYNC_WRITE: self._sync_write,
            Code.BULK_WRITE: self._bulk_write,
        }

    def __getitem__(self, servo_id: int) -> EmulatedServo:
        """The servo that has an id now. Raises KeyError."""
        for servo in self.servos:
            if servo.registers["ID"] == servo_id:
                return servo
        raise KeyError(servo_id)

    def advance(self) -> None:
        """Let happen what is due, though no bytes come."""
        now_ns = self.clock.now_ns()
        with self.lock:
            for servo in self.servos:
                servo.advance(now_ns)

    def receive(self, data: bytes, baud: int | None = None) -> list[Reply]:
        """What comes back for bytes sent at `baud` (None: one that everybody understands), in order of time."""
        now_ns = self.clock.now_ns()
        with self.lock:
            for servo in self.servos:
                servo.advance(now_ns)
            if baud != self._baud:
                self._parser.reset()
                self._baud = baud
            hearing = [o for o in self._obedient if o.servo.awake(now_ns) and baud in (None, o.servo.baud)]
            replies = [reply for packet in self._parser.feed(data) for reply in self._answers(packet, hearing, now_ns)]
        return sorted((reply for reply in replies if reply.data), key=lambda reply: reply.delay_s)

    def _answers(self, packet: Instruction | Status | BadCrc, hearing: list[Obedience], now_ns: int) -> Iterator[Reply]:
        if isinstance(packet, Status):
            return
        if isinstance(packet, BadCrc):
            for obedient in hearing:
                if packet.id == obedient.servo.registers["ID"] and obedient.servo.registers["Status Return Level"] == 2:
                    yield self._sent(obedient, obedient.status(packet.id, error=Error.CRC))
            return
        if packet.id == BROADCAST and packet.code in GROUP_READS:
            yield from self._group_read(packet, hearing, now_ns)
        elif packet.id == BROADCAST and packet.code in self._does:
            yield from self._does[packet.code](packet.params, hearing, now_ns)
        else:
            yield from self._single(packet, hearing, now_ns)

    def _single(self, packet: Instruction, hearing: list[Obedience], now_ns: int) -> Iterator[Reply]:
        for obedient in hearing:
            if obedient.means_me(packet.id):
                self._address(obedient, now_ns)
                stagger_s = 0.0
                if packet.id == BROADCAST and packet.code == Code.PING:
                    stagger_s = PING_STAGGER_S * obedient.servo.registers["ID"]
                delay_s = self._delay_s(obedient)
                status = obedient.obey(packet, now_ns)
                if status:
                    yield self._sent(obedient, status, stagger_s, delay_s)

    def _group_read(self, packet: Instruction, hearing: list[Obedience], now_ns: int) -> Iterator[Reply]:
        asked = list(_asked(packet))
        fast = packet.code in (Code.FAST_SYNC_READ, Code.FAST_BULK_READ)
        answers: list[tuple[Obedience, Status]] = []
        broken = False
        for servo_id, address, length in asked:
            obedient = next((o for o in hearing if o.servo.registers["ID"] == servo_id), None)
            if obedient is not None:
                self._address(obedient, now_ns)
            status = obedient.read_for_group(address, length) if obedient and not broken else None
            broken = broken or status is None
            if obedient is not None and status is not None:
                answers.append((obedient, status))
        delay_s = max((self._delay_s(obedient) for obedient, _ in answers), default=0.0)
        if not fast:
            for obedient, status in answers:
                yield self._sent(obedient, status, delay_s=delay_s)
        elif answers:
            whole = _chained([status for _, status in answers], [length for _, _, length in asked])
            late_s, data = self.faults.spoil(answers[0][1].id, whole)
            yield Reply(delay_s + late_s, data)

    def _sync_write(self, params: bytes, hearing: list[Obedience], now_ns: int) -> Iterator[Reply]:
        if len(params) >= 4:
            address, length = words(params[:4])
            for start in range(4, len(params) - length, length + 1):
                self._write_one(hearing, params[start], address, params[start + 1 : start + 1 + length], now_ns)
        yield from ()

    def _bulk_write(self, params: bytes, hearing: list[Obedience], now_ns: int) -> Iterator[Reply]:
        start = 0
        while start + 5 <= len(params):
            address, length = words(params[start + 1 : start + 5])
            data = params[start + 5 : start + 5 + length]
            if len(data) == length:
                self._write_one(hearing, params[start], address, data, now_ns)
            start += 5 + length
        yield from ()

    def _write_one(self, hearing: list[Obedience], servo_id: int, address: int, data: bytes, now_ns: int) -> None:
        for obedient in hearing:
            if servo_id != BROADCAST and obedient.means_me(servo_id):
                self._address(obedient, now_ns)
                obedient.write_for_group(address, data, now_ns)

    def _address(self, obedient: Obedience, now_ns: int) -> None:
        obedient.servo.heard(now_ns)
        obedient.servo.refresh(now_ns)

    def _delay_s(self, obedient: Obedience) -> float:
        return obedient.servo.registers["Return Delay Time"] * RETURN_DELAY_S

    def _sent(self, obedient: Obedience, status: Status, stagger_s: float = 0.0, delay_s: float | None = None) -> Reply:
        late_s, data = self.faults.spoil(status.id, encode(status))
        return Reply(stagger_s + late_s + (self._delay_s(obedient) if delay_s is None else delay_s), data)


class BusFaults(FaultScript):
    """The script of a bus: faults of replies, of its servos and of its port."""

    def __init__(self, bus: EmulatedBus, seed: int) -> None:
        super().__init__(seed)
        self._bus = bus

    def add(self, fault: Fault) -> None:
        """From now on, or when its time or position has come. Raises RigError for a servo that is not there."""
        if fault.kind in OF_REPLIES:
            with self._bus.lock:
                super().add(fault)
            return
        servos = [servo for servo in self._bus.servos if fault.servo_id in (None, servo.registers["ID"])]
        if not servos:
            raise RigError(f"no servo with id {fault.servo_id} on the emulated bus for the fault {fault.kind.value!r}")
        for servo in servos[: 1 if fault.kind == Kind.UNPLUG else None]:
            self._schedule(fault, servo)

    def _schedule(self, fault: Fault, servo: EmulatedServo) -> None:
        def happen(now_ns: int) -> None:
            if fault.kind == Kind.SILENT:
                servo.silent = True
            elif fault.kind == Kind.STUCK:
                servo.hold_fast(now_ns)
            elif fault.kind == Kind.OVERLOAD:
                servo.raise_alert(now_ns, OVERLOAD_ALERT)
            else:
                self._bus.unplug()

        if fault.at_counts is not None:
            servo.at_position(fault.at_counts, happen)
        else:
            servo.at_time(self._bus.clock.now_ns() if fault.at_ns is None else fault.at_ns, happen)


def _asked(packet: Instruction) -> Iterator[tuple[int, int, int]]:
    """Id, address and length for each servo of a group read."""
    params = packet.params
    if packet.code in (Code.BULK_READ, Code.FAST_BULK_READ):
        for start in range(0, len(params) - 4, 5):
            address, length = words(params[start + 1 : start + 5])
            yield params[start], address, length
    elif len(params) >= 4:
        address, length = words(params[:4])
        for servo_id in params[4:]:
            yield servo_id, address, length


def _chained(statuses: list[Status], lengths: list[int]) -> bytes:
    """The one status of a fast read: every servo adds its part and the CRC of all before; nothing is stuffed.

    The length announces what all are going to send, so a chain that breaks leaves it unfulfilled.
    """
    announced = sum(lengths) + 4 * len(lengths) + 1
    data = HEADER + bytes((BROADCAST,)) + announced.to_bytes(2, "little") + bytes((Code.STATUS,))
    for status, length in zip(statuses, lengths, strict=False):
        data += bytes((status.error, status.id)) + status.params.ljust(length, b"\0")[:length]
        data += crc16(data).to_bytes(2, "little")
    return data
