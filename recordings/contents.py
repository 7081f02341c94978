"""What is in a recording, whole or damaged, without decoding more than is asked for."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from io import BytesIO
from pathlib import Path

import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from viewsep.config import Config, parse_config
from viewsep.errors import BadConfig, BadRecording
from viewsep.messages import Result
from viewsep.recordings.codec import IMAGE_TOPIC, SCHEMAS, decode
from viewsep.recordings.jpeg import jpeg_size
from viewsep.recordings.reader import check_bytes
from viewsep.recordings.writer import SESSION

PROFILE = "viewsep"
PART = ".part"
_UNREADABLE = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError)


class State(StrEnum):
    """Whether a recording can be trusted."""

    WHOLE = "whole"
    DAMAGED = "damaged"
    UNFINISHED = "unfinished"


@dataclass(slots=True)
class Topic:
    """One topic: its schema, and messages with their first and last time (ns, the session's clock) and bytes."""

    name: str
    schema: str
    messages: int = 0
    size: int = 0
    first_ns: int = 0
    last_ns: int = 0

    @property
    def ours(self) -> bool:
        """Whether this version reads the topic; others stand there for other programs."""
        return self.name in SCHEMAS

    @property
    def rate_hz(self) -> float | None:
        """Messages per second, None where there is no telling."""
        return (self.messages - 1) / (self.last_ns - self.first_ns) * 1e9 if self.last_ns > self.first_ns else None

    def count(self, message: Message) -> None:
        """Take one more message into account."""
        self.first_ns = min(self.first_ns, message.log_time) if self.messages else message.log_time
        self.last_ns = max(self.last_ns, message.log_time)
        self.messages += 1
        self.size += len(message.data)


@dataclass(slots=True)
class Contents:
    """What a recording holds; of a damaged one, what stands before the damage.

    `problem` says what is wrong, empty when all is well. `topics` are in the order they begin, `attachments` are
    (name, media type, bytes), `pictures` counts sizes (width, height) in pixels.
    """

    path: Path
    size: int
    state: State
    problem: str
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: list[tuple[str, str, int]] = field(default_factory=list)
    topics: list[Topic] = field(default_factory=list)
    pictures: Counter[tuple[int, int]] = field(default_factory=Counter)
    result: Result | None = None

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last moment of all messages on the session's clock, None where there are none."""
        heard = [topic for topic in self.topics if topic.messages]
        return (min(t.first_ns for t in heard), max(t.last_ns for t in heard)) if heard else None

    @property
    def began_unix_ns(self) -> int | None:
        """When the first message was heard, nanoseconds since 1970, None where the recording does not say."""
        session = self.metadata.get(SESSION, {})
        try:
            anchor, stamp = int(session["anchor_unix_ns"]), int(session["anchor_stamp_ns"])
        except (KeyError, ValueError):
            return None
        return anchor + self.span_ns[0] - stamp if self.span_ns else anchor

    @property
    def build(self) -> dict[str, str]:
        """Names and versions of what made it."""
        return self.metadata.get("build", {})

    @property
    def config(self) -> Config | None:
        """The configuration, None where there is none that this version understands."""
        try:
            return parse_config(json.loads(self.metadata["config"]["json"]), "the recorded configuration")
        except (KeyError, ValueError, BadConfig):
            return None

    @property
    def candidates(self) -> list[tuple[str, str]]:
        """Names of the candidates in order, each with its model's digest (hex, empty where it is not known)."""
        digests = self.metadata.get("models", {})
        try:
            names = json.loads(self.metadata["task"]["candidates"])
        except (KeyError, ValueError):
            names = list(digests)
        return [(str(name), digests.get(str(name), "")) for name in names]

    @property
    def seed(self) -> int | None:
        """The task's seed, None where the recording does not say."""
        seed = self.metadata.get("task", {}).get("seed", "")
        return int(seed) if seed.isdecimal() else None

    @property
    def truth(self) -> str:
        """What was in the holder, empty where it is not known."""
        return self.metadata.get("task", {}).get("truth", "")


def look_into(path: Path) -> Contents:
    """What is in the file at `path`.

    A damaged recording is no error: `state` and `problem` tell. Raises BadRecording where there is no file, or one
    that viewsep has not made.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise BadRecording(f"{path}: no such file; check the name") from error
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read ({error.strerror}); give a recording's file") from error
    _check_origin(path, data)
    problem = ""
    try:
        check_bytes(data)
    except BadRecording as error:
        problem = str(error).partition(";")[0]  # what to do is for whoever tells it
    state = State.UNFINISHED if problem and path.suffix == PART else State.DAMAGED if problem else State.WHOLE
    contents = Contents(path, len(data), state, problem)
    _fill(contents, _records(data))
    return contents


def _check_origin(path: Path, data: bytes) -> None:
    """Raise BadRecording unless this is the beginning of a recording."""
    if not data:
        raise BadRecording(f"{path}: is empty; record again")
    if not data.startswith(MCAP0_MAGIC):
        raise BadRecording(f"{path}: is not an MCAP file (it begins with {data[:8].hex()}); give a recording")
    header = next(_records(data), None)
    if isinstance(header, Header) and header.profile != PROFILE:
        raise BadRecording(
            f"{path}: is an MCAP file of another program (profile {header.profile!r}, written by "
            f"{header.library!r}); give a recording of viewsep's"
        )


def _records(data: bytes) -> Iterator[McapRecord]:
    """The records one after the other, chunks opened, up to the end or the first that cannot be read."""
    try:
        yield from StreamReader(BytesIO(data), validate_crcs=True).records
    except _UNREADABLE:
        return


def _fill(contents: Contents, records: Iterator[McapRecord]) -> None:
    schemas: dict[int, str] = {}
    topics: dict[int, Topic] = {}
    by_name: dict[str, Topic] = {}
    for record in records:
        match record:
            case Metadata():
                contents.metadata[record.name] = record.metadata
            case Attachment():
                contents.attachments.append((record.name, record.media_type, len(record.data)))
            case Schema():
                schemas[record.id] = record.name
            case Channel():
                topic = Topic(record.topic, schemas.get(record.schema_id, ""))
                topics[record.id] = by_name.setdefault(record.topic, topic)
            case Message() if record.channel_id in topics:
                topics[record.channel_id].count(record)
                _read(contents, topics[record.channel_id].name, record.data)
    contents.topics = list(by_name.values())


def _read(contents: Contents, topic: str, data: bytes) -> None:
    """Note the size of a picture and the result; what this version cannot read is counted only."""
    try:
        if topic == IMAGE_TOPIC:
            contents.pictures[jpeg_size(CompressedImage.FromString(data).data)] += 1
        elif topic == "result":
            message = decode(topic, SCHEMAS[topic].FromString(data))
            assert isinstance(message, Result)
            contents.result = message
    except (DecodeError, BadRecording):
        return
