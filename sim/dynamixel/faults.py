"""Faults on purpose: a script of what goes wrong on the line and in the servos."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from viewsep.sim.dynamixel.packets import BROADCAST, HIGHEST_ID, Parser, Status, encode, with_crc


class Kind(StrEnum):
    """What goes wrong: first with a reply, then with a servo, then with the port."""

    LOST = "lost"
    LATE = "late"
    CORRUPT = "corrupt"
    TRUNCATED = "truncated"
    WRONG_ID = "wrong_id"
    GARBAGE = "garbage"
    SHORT_DATA = "short_data"
    NO_DATA = "no_data"
    SILENT = "silent"
    STUCK = "stuck"
    OVERLOAD = "overload"
    UNPLUG = "unplug"


OF_REPLIES = frozenset(list(Kind)[: list(Kind).index(Kind.SILENT)])


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    For replies: of `servo_id` (None: of any), the `nth` such reply from now on (1 is the next one; None: every one) for
    `count` replies, each with `probability`; `delay_s` is for late ones. For servos and the port: `at_ns` of the bus's
    clock, or `at_counts` of the shaft (not unplug), else at once.
    """

    kind: Kind
    servo_id: int | None = None
    nth: int | None = None
    count: int = 1
    probability: float = 1.0
    delay_s: float = 0.1
    at_ns: int | None = None
    at_counts: float | None = None


class FaultScript:
    """The faults of replies, in force until `clear`. The same seed gives the same bytes."""

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self._seen: dict[Fault, int] = {}

    def add(self, fault: Fault) -> None:
        """From now on."""
        self._seen[fault] = 0

    def clear(self) -> None:
        """Nothing goes wrong any more."""
        self._seen.clear()

    def __iter__(self) -> Iterator[Fault]:
        return iter(self._seen)

    def spoil(self, servo_id: int, reply: bytes) -> tuple[float, bytes]:
        """A reply as it arrives, and how much later: empty when it is lost."""
        delay_s = 0.0
        for fault in self._seen:
            if fault.servo_id not in (None, servo_id):
                continue
            self._seen[fault] += 1
            if fault.nth is not None and not fault.nth <= self._seen[fault] < fault.nth + fault.count:
                continue
            if self._random.random() >= fault.probability:
                continue
            if fault.kind == Kind.LATE:
                delay_s += fault.delay_s
            else:
                reply = self._spoilt(fault.kind, reply)
        return delay_s, reply

    def _spoilt(self, kind: Kind, reply: bytes) -> bytes:
        if kind == Kind.LOST or not reply:
            return b""
        if kind == Kind.CORRUPT:
            index = self._random.randrange(4, len(reply))
            return reply[:index] + bytes((reply[index] ^ 1 << self._random.randrange(8),)) + reply[index + 1 :]
        if kind == Kind.TRUNCATED:
            return reply[: self._random.randrange(1, len(reply))]
        if kind == Kind.WRONG_ID:
            return with_crc(reply[:4] + bytes(((reply[4] + 1) % HIGHEST_ID,)) + reply[5:-2])
        if kind == Kind.GARBAGE:
            return self._random.randbytes(self._random.randrange(1, 12)) + reply
        kept = -1 if kind == Kind.SHORT_DATA else 0
        packets = Parser().feed(reply)
        if len(packets) != 1 or not isinstance(status := packets[0], Status) or status.id == BROADCAST:
            return reply
        return encode(Status(status.id, status.error, status.params[:kept]))
