"""DYNAMIXEL Protocol 2.0 on the wire: packets to bytes and back, after ROBOTIS' e-manual (protocol2).

A packet is `FF FF FD 00 | id | length | code | parameters | CRC`, length and CRC least significant byte first, length
counted from the code on. Where `FF FF FD` occurs from the code to the last parameter, another `FD` follows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xff\xff\xfd\x00"
PATTERN = HEADER[:3]
STUFFED = PATTERN + b"\xfd"
BROADCAST = 0xFE
HIGHEST_ID = 0xFC
SHORTEST = 3  # length of a packet without parameters
LONGEST = 1024  # longer ones are taken for noise
_BODY = 7  # index of the code


class Code(IntEnum):
    """What is asked of a servo."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Why a servo did not do what it was asked: the low bits of a status packet's error."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80  # bit of the error: look at Hardware Error Status


@dataclass(frozen=True, slots=True)
class Instruction:
    """From the controller to one servo, or to all (`BROADCAST`)."""

    id: int
    code: int
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class Status:
    """A servo's answer."""

    id: int
    error: int = 0
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class BadCrc:
    """A packet for `id` arrived damaged."""

    id: int


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC_TABLE = _crc_table()


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16 with the polynomial x^16 + x^15 + x^2 + 1, not reflected, from `crc` on."""
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ _CRC_TABLE[crc >> 8 ^ byte]
    return crc


def with_crc(data: bytes) -> bytes:
    """`data` and its CRC."""
    return data + crc16(data).to_bytes(2, "little")


def stuff(body: bytes) -> bytes:
    """Code and parameters as they go over the wire."""
    return body.replace(PATTERN, STUFFED)


def unstuff(body: bytes) -> bytes:
    """The opposite of `stuff`."""
    return body.replace(STUFFED, PATTERN)


def encode(packet: Instruction | Status) -> bytes:
    """The packet's bytes. Raises ValueError when the id or the length does not fit."""
    if isinstance(packet, Status):
        body = bytes((Code.STATUS, packet.error)) + packet.params
    else:
        body = bytes((packet.code,)) + packet.params
    return frame(packet.id, stuff(body))


def frame(packet_id: int, body: bytes) -> bytes:
    """Header, id, length and CRC around a body that is stuffed already."""
    if not (0 <= packet_id <= HIGHEST_ID or packet_id == BROADCAST):
        raise ValueError(f"no packet can have the id {packet_id}: use 0 to {HIGHEST_ID} or {BROADCAST}")
    if len(body) + 2 > LONGEST:
        raise ValueError(f"{len(body)} bytes are too long for a packet: at most {LONGEST - 2}")
    return with_crc(HEADER + bytes((packet_id,)) + (len(body) + 2).to_bytes(2, "little") + body)


class Parser:
    """Packets from bytes in pieces of any size. Whatever came before a whole packet, that packet is found."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def reset(self) -> None:
        """Forget what has not become a packet."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[Instruction | Status | BadCrc]:
        """What is complete with `data`, in order."""
        buffer = self._buffer
        buffer += data
        found: list[Instruction | Status | BadCrc] = []
        while (start := buffer.find(PATTERN)) >= 0:
            del buffer[:start]
            skipped, packet = self._first()
            if skipped == 0:
                return found
            del buffer[:skipped]
            if packet:
                found.append(packet)
        del buffer[: max(0, len(buffer) - 2)]  # two bytes may begin a header
        return found

    def _first(self) -> tuple[int, Instruction | Status | BadCrc | None]:
        """How many bytes are done with, and the packet they were; (0, None): wait for more."""
        buffer = self._buffer
        if len(buffer) < _BODY:
            return (3 if len(buffer) > 3 and buffer[3] else 0), None
        packet_id, length = buffer[4], buffer[5] | buffer[6] << 8
        if buffer[3] or packet_id in (0xFD, 0xFF) or not SHORTEST <= length <= LONGEST:
            return 3, None
        end = _BODY + length
        if inner := self._inner_header(end - 2):
            return inner, None
        if len(buffer) < end:
            return 0, None
        whole = bytes(buffer[:end])
        if crc16(whole[:-2]) != whole[-2] | whole[-1] << 8:
            return 3, BadCrc(packet_id)  # the rest may hold the next packet
        body = unstuff(whole[_BODY:-2])
        if body[0] != Code.STATUS:
            return end, Instruction(packet_id, body[0], body[1:])
        return end, Status(packet_id, body[1], body[2:]) if len(body) > 1 else None

    def _inner_header(self, body_end: int) -> int:
        """Where a header begins within the body, 0 if nowhere: stuffed bodies have none, so the packet was cut off."""
        buffer = self._buffer
        at = _BODY
        while (at := buffer.find(PATTERN, at, body_end)) >= 0:
            if at + 3 == body_end or (at + 3 < len(buffer) and buffer[at + 3] != 0xFD):
                return at
            at += 3
        return 0
