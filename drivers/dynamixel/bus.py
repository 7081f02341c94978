"""A bus of servos, Protocol 2.0: dynamixel-sdk behind a wrapper that believes only what is certain.

What the SDK leaves open is closed here: a value counts only when its packet came from the servo that was asked, with
the length that was asked for; a line on which a reply was missed is drained, and every other read of a block asks for
one byte more, so that a late reply is known by its length; a silent servo does not silence the others; alert bits are
kept; bytes that look like a header are stuffed; any number of threads may call.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

from dynamixel_sdk.robotis_def import COMM_RX_CORRUPT, COMM_SUCCESS

from viewsep.drivers.dynamixel.control_table import Register, model_name
from viewsep.drivers.dynamixel.errors import NoReply, PortLost, ServoRefused
from viewsep.drivers.dynamixel.packets import HEADER, SYNC_WRITE, Packets, words
from viewsep.drivers.dynamixel.port import SerialPort, Trace

BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, SYNC_READ = 0x01, 0x02, 0x03, 0x08, 0x82
ALERT = 0x80
REFUSALS = {
    1: "could not carry the instruction out",
    2: "does not know the instruction",
    3: "received a damaged packet",
    4: "says the value is out of range",
    5: "says the value has a wrong length",
    6: "says the value is beyond its limit",
    7: "says the register is locked (EEPROM while the torque is on) or read-only",
}
DAMAGED = 3  # the refusal that a retry may mend
OVERHEAD = 11  # bytes of a status packet without parameters
DRAIN_S = 0.1  # longest
BAUDS = (57600, 1_000_000, 115200, 2_000_000, 3_000_000, 4_000_000, 9600)
"""What X-series servos can be set to, the likeliest first."""


@dataclass(frozen=True, slots=True)
class Found:
    """A servo that answered a ping."""

    servo_id: int
    model_number: int
    firmware: int
    baud: int

    @property
    def model(self) -> str:
        """Its model's name."""
        return model_name(self.model_number)


@dataclass(frozen=True, slots=True)
class Reply:
    """What one servo answered: its data, and whether its alert bit was set (something is wrong with the hardware)."""

    data: bytes
    alert: bool


@dataclass(frozen=True, slots=True)
class BusStatistics:
    """Counted since the bus was made: bytes both ways, instructions, and what went wrong on the line."""

    instructions: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    retries: int = 0
    timeouts: int = 0
    damaged: int = 0
    strange: int = 0


class Bus:
    """Servos on one serial port. Nothing is opened before `open()`; every error is a BusError.

    `dry_run` reads, but only traces what would change a servo.
    """

    def __init__(
        self, port: str, baud: int, *, retries: int = 3, trace: Trace | None = None, dry_run: bool = False
    ) -> None:
        self.dry_run = dry_run
        self._port = SerialPort(port, baud, trace)
        self._packets = Packets()
        self._retries = retries
        self._trace = trace
        self._lock = threading.RLock()
        self._longer = 0
        self._statistics = BusStatistics()

    @property
    def port(self) -> str:
        """The port's name."""
        return self._port.name

    @property
    def baud(self) -> int:
        """Bits per second."""
        return self._port.baud

    @property
    def is_open(self) -> bool:
        """Whether the port is held."""
        return self._port.is_open

    @property
    def statistics(self) -> BusStatistics:
        """Counted up to now."""
        return self._statistics

    def request_time_s(self, count: int) -> float:
        """How long the request for a block of `count` servos is on the line."""
        return self._port.wire_time_s(HEADER + 7 + count)

    def open(self) -> None:
        """Take the port. Raises PortLost."""
        with self._lock:
            self._port.open()

    def close(self) -> None:
        """Give the port back. Safe to call twice."""
        with self._lock:
            self._port.close()

    @contextmanager
    def together(self) -> Iterator[None]:
        """Instructions that no other thread's come in between of."""
        with self._lock:
            yield

    def ping(self, servo_id: int, retries: int | None = None) -> Found:
        """Ask a servo who it is. Raises NoReply, PortLost."""
        reply = self._ask(servo_id, PING, b"", 3, retries)
        return Found(servo_id, int.from_bytes(reply.data[:2], "little"), reply.data[2], self.baud)

    def ping_each(self, servo_ids: Sequence[int]) -> list[Found]:
        """Those of some servos that answer. Raises PortLost."""
        found = []
        for servo_id in servo_ids:
            with suppress(NoReply):
                found.append(self.ping(servo_id))
        return found

    def ping_all(self) -> list[Found]:
        """Every servo that answers at this baud, by id. Takes 0.8 s to 1.5 s: each id has its turn. Raises PortLost."""
        with self._instruction():
            self._send(BROADCAST, PING, b"")
            turns = 253
            self._port.wait_at_most(self._port.wire_time_s(14 * turns) + 0.003 * turns + 2 * self._port.latency_s)
            found = {}
            while not self._port.isPacketTimeout():
                status = self._receive()
                if status is not None and len(status.data) == 3:
                    number = int.from_bytes(status.data[:2], "little")
                    found[status.servo_id] = Found(status.servo_id, number, status.data[2], self.baud)
        return [found[servo_id] for servo_id in sorted(found)]

    def read(self, servo_id: int, register: Register) -> int:
        """A register's counts. Raises NoReply, ServoRefused, PortLost."""
        parameters = words(register.address, register.size)
        return register.decode(self._ask(servo_id, READ, parameters, register.size, what=register.name).data)

    def read_block(self, servo_ids: Sequence[int], address: int, size: int) -> dict[int, Reply]:
        """The same addresses of several servos in one exchange, with one address more at every other time.

        Those that did not answer with the others are asked one by one. Raises NoReply, ServoRefused, PortLost.
        """
        replies = self._read_together(servo_ids, address, size) if len(servo_ids) > 1 else {}
        for servo_id in servo_ids:
            if servo_id not in replies:
                replies[servo_id] = self._read_one(servo_id, address, size, None)
        return replies

    def read_what_answers(self, servo_ids: Sequence[int], address: int, size: int) -> dict[int, Reply]:
        """The same addresses of several servos, without those that do not answer. Raises PortLost.

        A silent servo can keep those after it waiting for their turn, so whoever is missing is asked once more, alone.
        """
        replies = self._read_together(servo_ids, address, size)
        for servo_id in servo_ids:
            if servo_id not in replies:
                with suppress(NoReply, ServoRefused):
                    replies[servo_id] = self._read_one(servo_id, address, size, 0)
        return replies

    def _read_together(self, servo_ids: Sequence[int], address: int, size: int) -> dict[int, Reply]:
        with self._instruction():
            asked = self._next_length(size)
            parameters = words(address, asked) + bytes(servo_ids)
            self._send(BROADCAST, SYNC_READ, parameters)
            self._port.setPacketTimeout((OVERHEAD + asked) * len(servo_ids))
            replies: dict[int, Reply] = {}
            while len(replies) < len(servo_ids):
                status = self._receive()
                if status is None:
                    self._count(timeouts=1)
                    self._drain()
                    break
                if status.servo_id in servo_ids and len(status.data) == asked:
                    replies[status.servo_id] = Reply(status.data[:size], bool(status.error & ALERT))
                else:
                    self._count(strange=1)
            return replies

    def write(self, servo_id: int, register: Register, counts: int) -> None:
        """Set a register. Raises NoReply, ServoRefused, PortLost."""
        what = f"{register.name} = {counts}"
        self._ask(servo_id, WRITE, words(register.address) + register.encode(counts), 0, what=what)

    def write_unanswered(self, servo_id: int, register: Register, counts: int) -> None:
        """Set a register of a servo that may not be set to answer. Raises PortLost."""
        with self._instruction():
            self._send(servo_id, WRITE, words(register.address) + register.encode(counts))
            if not self.dry_run:
                self._port.setPacketTimeout(OVERHEAD)
                self._receive()

    def write_all(self, counts: Mapping[int, int], register: Register) -> None:
        """Set one register of several servos at the same moment; none of them answers. Raises PortLost."""
        with self._instruction():
            parameters = words(register.address, register.size)
            for servo_id, value in counts.items():
                parameters += bytes([servo_id]) + register.encode(value)
            self._send(BROADCAST, SYNC_WRITE, parameters)

    def reboot(self, servo_id: int) -> None:
        """Start a servo anew, which clears its alert; it answers again about half a second later. Raises NoReply."""
        self._ask(servo_id, REBOOT, b"", 0)

    def _read_one(self, servo_id: int, address: int, size: int, retries: int | None) -> Reply:
        """A block of one servo, each attempt of another length. Raises NoReply, ServoRefused, PortLost."""
        for _ in range(self._retries if retries is None else retries):
            with suppress(NoReply):
                return self._read_block_once(servo_id, address, size)
        return self._read_block_once(servo_id, address, size)

    def _read_block_once(self, servo_id: int, address: int, size: int) -> Reply:
        with self._lock:
            asked = self._next_length(size)
            reply = self._ask(servo_id, READ, words(address, asked), asked, 0, what=f"address {address}")
            return replace(reply, data=reply.data[:size])

    def _ask(
        self, servo_id: int, instruction: int, parameters: bytes, size: int, retries: int | None = None, what: str = ""
    ) -> Reply:
        """One instruction to one servo until it has answered with `size` bytes or the retries are spent."""
        attempts = 1 + (self._retries if retries is None else retries)
        for attempt in range(attempts):
            with self._instruction():
                self._count(retries=int(attempt > 0))
                self._send(servo_id, instruction, parameters)
                if self.dry_run and _changes(instruction):
                    return Reply(b"", False)
                self._port.setPacketTimeout(OVERHEAD + size)
                status = self._answer_of(servo_id, size)
            if status is not None and status.error & ~ALERT not in (0, DAMAGED):
                reason = REFUSALS.get(status.error & ~ALERT, f"answers with error {status.error & ~ALERT}")
                raise ServoRefused(f"servo {servo_id} {reason}" + (f": {what}" if what else ""))
            if status is not None and status.error & ~ALERT == 0:
                return Reply(status.data, bool(status.error & ALERT))
        raise NoReply(
            f"servo {servo_id} on {self.port} at {self.baud} baud does not answer ({attempts} attempts): check cable, "
            "power, id and baud, e.g. with `viewsep rig scan`"
        )

    def _answer_of(self, servo_id: int, size: int) -> _Status | None:
        """The status packet of one servo that has the right length, or an error instead of it; None in time."""
        while (status := self._receive()) is not None:
            if status.servo_id == servo_id and (len(status.data) == size or status.error & ~ALERT):
                return status
            self._count(strange=1)
        self._count(timeouts=1)
        self._drain()
        return None

    def _next_length(self, size: int) -> int:
        """One byte more at every second read, so that the reply to the read before cannot be taken for this one's."""
        self._longer ^= 1
        return size + self._longer

    @contextmanager
    def _instruction(self) -> Iterator[None]:
        """One exchange, alone on the line. The SDK's own guard would stay up after an error for ever."""
        with self._lock:
            try:
                yield
            finally:
                self._port.is_using = False

    def _send(self, servo_id: int, instruction: int, parameters: bytes) -> None:
        packet = [0] * 4 + [servo_id, *words(len(parameters) + 3), instruction, *parameters, 0, 0]
        if self.dry_run and _changes(instruction):
            if self._trace is not None:
                self._trace("would send", self._packets.as_sent(packet))
            return
        self._port.is_using = False
        if self._packets.txPacket(self._port, packet) != COMM_SUCCESS:
            raise PortLost(f"the serial port {self.port} did not take a packet: check the adapter")
        self._count(instructions=1, bytes_sent=len(packet))

    def _receive(self) -> _Status | None:
        """The next whole status packet, None when the deadline passes. Damaged ones are counted and skipped."""
        while True:
            packet, result = self._packets.rxPacket(self._port, False)
            received = self._port.take_received()
            self._count(bytes_received=len(received), damaged=int(result == COMM_RX_CORRUPT and len(received) > 0))
            if received and self._trace is not None:
                self._trace("<", received)
            if result == COMM_SUCCESS:
                length = packet[5] | packet[6] << 8
                if length >= 4:
                    return _Status(packet[4], packet[8], bytes(packet[9 : HEADER + length - 2]))
                self._count(strange=1)
            elif self._port.isPacketTimeout():
                return None

    def _drain(self) -> None:
        self._port.drain(2 * self._port.latency_s, DRAIN_S)

    def _count(self, **more: int) -> None:
        counted = {name: getattr(self._statistics, name) + count for name, count in more.items() if count}
        if counted:
            self._statistics = replace(self._statistics, **counted)


def scan(port: str, bauds: Sequence[int] = BAUDS, trace: Trace | None = None) -> Iterator[tuple[int, list[Found]]]:
    """Every servo on a port, baud by baud as they are tried. Raises PortLost."""
    for baud in bauds:
        bus = Bus(port, baud, trace=trace)
        bus.open()
        try:
            yield baud, bus.ping_all()
        finally:
            bus.close()


@dataclass(frozen=True, slots=True)
class _Status:
    servo_id: int
    error: int
    data: bytes


def _changes(instruction: int) -> bool:
    return instruction not in (PING, READ, SYNC_READ)


def wait_for(bus: Bus, servo_id: int, timeout_s: float) -> Found:
    """Ping until a servo that was started anew answers. Raises NoReply after `timeout_s`, PortLost."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        try:
            return bus.ping(servo_id, retries=0)
        except NoReply:
            if time.monotonic() > deadline_s:
                raise


__all__ = ["BAUDS", "Bus", "BusStatistics", "Found", "Reply", "scan", "wait_for"]
