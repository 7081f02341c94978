"""What a rig publishes, as it comes: messages, log lines and pictures.

Subscribers keep what is new in rings and drop the oldest when nobody fetches it, so that a slow client never holds up
anybody; what was dropped shows as gaps in the sequence numbers. Nothing here calls back or starts a thread.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic, Self, TypeAlias, TypeVar

import zenoh
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from zenoh.handlers import Handler, RingChannel

from viewsep.errors import BadRecording
from viewsep.recordings.codec import SCHEMAS, Recordable, RecordedFrame, decode, decode_frame
from viewsep.service.names import LOG, STREAMS, Keys, read_attachment

_RING = 2048  # messages per topic, some minutes of the fastest one
_PICTURES = 2
_POLL_S = 0.01
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class LogLine:
    """What a role, `name`, says to people at a Unix time.

    `level` is DEBUG, INFO, WARNING, ERROR, FATAL or UNKNOWN.
    """

    stamp_ns: int
    level: str
    name: str
    message: str


@dataclass(frozen=True, slots=True)
class Received:
    """One message with its topic, its sequence number there, and when it arose: the rig's clock, of log lines Unix."""

    topic: str
    sequence: int
    stamp_ns: int
    message: Recordable | LogLine


_Sample: TypeAlias = tuple[str, int, int, bytes]  # topic, sequence, stamp_ns, payload


class _Fetching(Generic[Item]):
    """Fetches items as they come; iterate, or `receive` with a timeout. Close it, or use it in a `with`."""

    def __init__(self) -> None:
        self.closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __iter__(self) -> Iterator[Item]:
        """Every item until it is closed."""
        while not self.closed:
            item = self.receive(1.0)
            if item is not None:
                yield item

    def receive(self, timeout_s: float) -> Item | None:
        """The next item, None when none comes within `timeout_s` (0: only what is there)."""
        deadline = time.monotonic() + timeout_s
        while not self.closed:
            item = self._next()
            if item is not None:
                return item
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0:
                break
            time.sleep(min(_POLL_S, remaining_s))
        return None

    def _next(self) -> Item | None:
        raise NotImplementedError

    def close(self) -> None:
        """Stop listening; more than once does no harm."""
        raise NotImplementedError


class Stream(_Fetching[Received]):
    """The messages of some topics; those that wait together come in the order of their stamps,
    the log, which has the wall clock's, before the others.

    `gaps` counts messages that were lost on the way, `unreadable` those that this version cannot decode.
    """

    def __init__(self, session: zenoh.Session, rig: str, topics: Sequence[str] = STREAMS) -> None:
        super().__init__()
        self.gaps = 0
        self.unreadable = 0
        self._last: dict[tuple[str, str], int] = {}
        self._waiting: deque[_Sample] = deque()
        keys = Keys(rig)
        self._subscribers: dict[str, zenoh.Subscriber[Handler[zenoh.Sample]]] = {
            topic: session.declare_subscriber(keys.key(topic), RingChannel(_RING)) for topic in topics
        }

    def close(self) -> None:
        """Stop listening; more than once does no harm."""
        self.closed = True
        while self._subscribers:
            self._subscribers.popitem()[1].undeclare()

    def _next(self) -> Received | None:
        if not self._waiting:
            self._fetch()
        while self._waiting:
            received = self._read(*self._waiting.popleft())
            if received is not None:
                return received
        return None

    def _fetch(self) -> None:
        fetched: list[_Sample] = []
        for topic, subscriber in self._subscribers.items():
            for _ in range(_RING):  # so that a fast topic cannot hold up the others
                sample = subscriber.try_recv()
                if sample is None:
                    break
                place = _place(sample)
                if place is None:
                    self.unreadable += 1
                else:
                    fetched.append((topic, *place, sample.payload.to_bytes()))
        self._waiting.extend(sorted(fetched, key=lambda item: (item[0] != LOG, item[2])))  # the log has its own clock

    def _read(self, topic: str, sequence: int, stamp_ns: int, payload: bytes) -> Received | None:
        try:
            message = _decode(topic, payload)
        except (DecodeError, BadRecording):
            self.unreadable += 1
            return None
        source = (topic, message.name if isinstance(message, LogLine) else "")  # both roles write the log
        self.gaps += _lost(self._last.get(source), sequence)
        self._last[source] = sequence
        return Received(topic, sequence, stamp_ns, message)


class Pictures(_Fetching[RecordedFrame]):
    """The newest pictures, still compressed, on a session of its own; `dropped` counts those that were skipped."""

    def __init__(self, session: zenoh.Session, rig: str) -> None:
        super().__init__()
        self.dropped = 0
        self.unreadable = 0
        self._last: int | None = None
        self._session = session
        self._subscriber = session.declare_subscriber(Keys(rig).image, RingChannel(_PICTURES))

    def close(self) -> None:
        """Stop listening and close the session; more than once does no harm."""
        if not self.closed:
            self.closed = True
            self._subscriber.undeclare()
            self._session.close()

    def _next(self) -> RecordedFrame | None:
        while (sample := self._subscriber.try_recv()) is not None:
            place = _place(sample)
            picture = CompressedImage()
            try:
                picture.ParseFromString(sample.payload.to_bytes())
            except DecodeError:
                place = None
            if place is None:
                self.unreadable += 1
                continue
            self.dropped += _lost(self._last, place[0])
            self._last = place[0]
            return decode_frame(place[0], picture, None)
        return None


def _place(sample: zenoh.Sample) -> tuple[int, int] | None:
    """Sequence and stamp, None where the attachment is not ours."""
    try:
        return read_attachment(b"" if sample.attachment is None else sample.attachment.to_bytes())
    except ValueError:
        return None


def _lost(last: int | None, sequence: int) -> int:
    """How many messages lie between; none when the numbers begin again, as after a restart."""
    return 0 if last is None or sequence <= last else sequence - last - 1


def _decode(topic: str, payload: bytes) -> Recordable | LogLine:
    if topic == LOG:
        log = Log.FromString(payload)
        stamp_ns = log.timestamp.seconds * 1_000_000_000 + log.timestamp.nanos
        return LogLine(stamp_ns, _level(log.level), log.name, log.message)
    protobuf: Protobuf = SCHEMAS[topic].FromString(payload)
    return decode(topic, protobuf)


def _level(level: Any) -> str:
    try:
        return Log.Level.Name(level)
    except ValueError:
        return "UNKNOWN"
