"""The streams of a service: messages as protobuf, pictures that may be dropped, and the log."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Iterable

import zenoh
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp

from viewsep.messages import Frame, HypothesisViews, Keyframe, Message
from viewsep.recordings.codec import IMAGE_TOPIC, encode, encode_picture, serialise
from viewsep.service.names import LOG, Keys, attachment, encoding

DROPPED = frozenset({IMAGE_TOPIC, "motion/state", LOG})
"""Streams of which only the newest counts: a link that cannot keep up loses messages of these instead of waiting."""
LOGGER = "viewsep.service"
"""What the service says to people; every role has a child of it."""
LEVELS = {
    logging.DEBUG: Log.DEBUG,
    logging.INFO: Log.INFO,
    logging.WARNING: Log.WARNING,
    logging.ERROR: Log.ERROR,
    logging.CRITICAL: Log.FATAL,
}


class Streams:
    """A `Listener` that publishes what it hears on the given topics. Frames are published on a session of their own."""

    def __init__(self, session: zenoh.Session, keys: Keys, topics: Iterable[str]) -> None:
        self._publishers = {topic: _publisher(session, keys, topic) for topic in topics}
        self._sent: Counter[str] = Counter()
        self._lock = threading.Lock()

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Publish a message if its topic is ours; pictures are compressed only when somebody watches."""
        if isinstance(message, Frame):
            if IMAGE_TOPIC in self._publishers and _watched(self._publishers[IMAGE_TOPIC]):
                self.put(IMAGE_TOPIC, stamp_ns, serialise(encode_picture(message)))
            return
        if isinstance(message, HypothesisViews | Keyframe):
            return
        topic, protobuf = encode(message)
        if topic in self._publishers:
            self.put(topic, stamp_ns, serialise(protobuf))

    def put(self, topic: str, stamp_ns: int, payload: bytes) -> None:
        """Publish bytes; a gap in the sequence numbers is a message that was dropped on the way."""
        with self._lock:
            sequence = self._sent[topic]
            self._sent[topic] += 1
            self._publishers[topic].put(payload, attachment=attachment(sequence, stamp_ns))

    def watched(self) -> frozenset[str]:
        """The topics that somebody subscribes to."""
        return frozenset(topic for topic, publisher in self._publishers.items() if _watched(publisher))

    def close(self) -> None:
        """Undeclare all of them."""
        for publisher in self._publishers.values():
            publisher.undeclare()
        self._publishers = {}


class LogStream(logging.Handler):
    """Publishes a role's log records as foxglove.Log; `role` is its name there. Times are those of the wall clock.

    `whole_process` adds what is of no role, such as connections; one role of a process does that.
    """

    def __init__(self, streams: Streams, role: str, *, whole_process: bool) -> None:
        super().__init__(logging.INFO)
        self._streams = streams
        self._role = role
        self._loggers = {f"{LOGGER}.{role}"} | ({LOGGER} if whole_process else set())
        self.addFilter(lambda record: record.name in self._loggers)

    def emit(self, record: logging.LogRecord) -> None:
        """Publish one record."""
        unix_ns = round(record.created * 1e9)
        stamp = Timestamp(seconds=unix_ns // 1_000_000_000, nanos=unix_ns % 1_000_000_000)
        level = LEVELS.get(record.levelno, Log.UNKNOWN)
        log = Log(timestamp=stamp, level=level, message=record.getMessage(), name=self._role)
        try:
            self._streams.put(LOG, unix_ns, serialise(log))
        except Exception:
            self.handleError(record)


def _watched(publisher: zenoh.Publisher) -> bool:
    """Whether anybody subscribes."""
    return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]  # the stub says bool


def _publisher(session: zenoh.Session, keys: Keys, topic: str) -> zenoh.Publisher:
    drops = topic in DROPPED
    return session.declare_publisher(
        keys.key(topic),
        encoding=encoding(topic),
        congestion_control=zenoh.CongestionControl.DROP if drops else zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.DATA_LOW if drops else zenoh.Priority.DATA,
    )
