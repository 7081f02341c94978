"""Reads a recording back, in the order it was heard, and notices any changed byte.

Every byte of a recording stands under a CRC32: the data section under the one in its DataEnd record, the summary and
the footer under the one in the footer. mcap's readers check the first only on request and the second never, so both
are checked here before anything is parsed; both magics and the records between them are at fixed places.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from viewsep.errors import BadRecording
from viewsep.recordings.codec import (
    IMAGE_TOPIC,
    MASK_TOPIC,
    PICTURES,
    SCHEMAS,
    Recordable,
    RecordedFrame,
    decode,
    decode_frame,
)
from viewsep.recordings.scan import PARSE_ERRORS, RECORD, Damage, scan
from viewsep.recordings.version import VERSION

RECOVER = "`viewsep recordings recover` saves what is left"

_DATA_END = struct.Struct("<BQI")  # opcode, length, CRC of everything before
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, CRC of summary and footer


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as it was heard at `stamp_ns`; `raw` is its recorded protobuf, `number` counts all of a recording."""

    topic: str
    stamp_ns: int
    message: Recordable
    raw: bytes
    number: int = 0


@dataclass(frozen=True, slots=True)
class Recording:
    """A whole recording: metadata records by name, attachments' bytes by name, messages in the order they were heard.

    `frames` are the pictures, still compressed, in their own order; a percept belongs to the frame with its stamp.
    `gaps` are the places in `messages` before which some are missing: they were lost with a damaged part of the file,
    or stand in the file before.
    """

    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    messages: tuple[Recorded, ...]
    frames: tuple[RecordedFrame, ...]
    gaps: frozenset[int] = frozenset()


def read_recording(path: Path) -> Recording:
    """Everything in the recording at `path`.

    Topics of others are left out. Raises BadRecording when the file is missing, is not MCAP, is truncated or changed in
    any byte, was made by a newer version, or holds a schema, kind of event or field that this version does not know.
    """
    data = read_bytes(path)
    try:
        check_bytes(data)
        return _parse(data)
    except BadRecording as error:
        raise BadRecording(f"{path}: {error}") from error
    except (*PARSE_ERRORS, DecodeError) as error:
        raise BadRecording(f"{path}: its records make no sense ({error}); it was not written by viewsep") from error


def joined(parts: Sequence[Recording]) -> Recording:
    """The files of one recording as one, in whatever order they are given.

    Raises BadRecording when they are of different ones.
    """
    sessions = [part.metadata.get("session", {}) for part in parts]
    if len(parts) > 1 and len({session.get("opened_unix_ns") for session in sessions}) > 1:
        raise BadRecording("these are not parts of one recording: give the files of one, or each of them alone")
    ordered = sorted(parts, key=lambda part: int(part.metadata.get("session", {}).get("part", "1")))
    messages: list[Recorded] = []
    gaps: set[int] = set()
    for part in ordered:
        begin = len(messages)
        inside = {begin + gap for gap in part.gaps if gap > 0}
        follows = part.messages and part.messages[0].number == (messages[-1].number + 1 if messages else 0)
        gaps |= inside if follows else inside | {begin}
        messages += part.messages
    frames = tuple(frame for part in ordered for frame in part.frames)
    return replace(ordered[0], messages=tuple(messages), frames=frames, gaps=frozenset(gaps))


def read_bytes(path: Path) -> bytes:
    """The file's bytes. Raises BadRecording."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise BadRecording(f"{path}: no such file; check the name") from error
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read ({error.strerror}); give a recording's file") from error


def check_bytes(data: bytes) -> None:
    """Raise BadRecording unless magics, DataEnd and footer stand where they belong and every byte matches its CRC."""
    if not data:
        raise BadRecording("is empty; record again")
    if not data.startswith(MCAP0_MAGIC):
        raise BadRecording(f"does not start as an MCAP file (first bytes {data[:8].hex()}); give a recording")
    footer_start = len(data) - len(MCAP0_MAGIC) - _FOOTER.size
    if footer_start < len(MCAP0_MAGIC) or not data.endswith(MCAP0_MAGIC):
        raise BadRecording(f"does not end as an MCAP file after {len(data)} bytes: truncated; {RECOVER}")
    opcode, length, summary_start, _, summary_crc = _FOOTER.unpack_from(data, footer_start)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - RECORD.size):
        raise BadRecording(f"has no footer at byte {footer_start}: damaged; {RECOVER}")
    data_end = summary_start - _DATA_END.size
    summary = memoryview(data)[summary_start : footer_start + _FOOTER.size - 4]
    if summary_start > footer_start or data_end < 0 or zlib.crc32(summary) != summary_crc:
        raise BadRecording(f"its summary and footer up to byte {len(data)} do not match their CRC; {RECOVER}")
    opcode, length, data_crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, _DATA_END.size - RECORD.size):
        raise BadRecording(f"its data section does not end at byte {data_end}: damaged; {RECOVER}")
    checked_whole = data_crc != 0  # tools that rewrite recordings leave it out: then the chunks' own must do
    if checked_whole and zlib.crc32(memoryview(data)[:data_end]) != data_crc:
        what = _damaged_part(data, data_end) or f"its data section (bytes 0 to {data_end})"
        raise BadRecording(f"{what} does not match its CRC; {RECOVER}")
    if not checked_whole and _damaged_part(data, data_end):
        raise BadRecording(f"{_damaged_part(data, data_end)} does not match its CRC; {RECOVER}")


def _damaged_part(data: bytes, data_end: int) -> str:
    """The first record of the data section that is not sound, for the message; empty when all are."""
    for piece in scan(memoryview(data)[:data_end]):
        if isinstance(piece, Damage):
            return f"its {piece.what} at byte {piece.start}"
    return ""


def _parse(data: bytes) -> Recording:
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages: list[tuple[str, Message]] = []
    for record in StreamReader(BytesIO(data), validate_crcs=True).records:
        match record:
            case Metadata(name=name):
                metadata[name] = record.metadata
            case Attachment(name=name):
                attachments[name] = record.data
            case Schema(id=number):
                schemas[number] = record
            case Channel(id=number):
                _check_channel(record, schemas.get(record.schema_id))
                channels[number] = record
            case Message(channel_id=number):
                if number not in channels:
                    raise BadRecording(f"a message at {record.log_time} ns is on channel {number}, which is not there")
                messages.append((channels[number].topic, record))
    counted = _check_version(metadata.get("session", {})) >= 2
    pictures = [row for row in messages if row[0] in PICTURES]
    others = [row for row in messages if row[0] in SCHEMAS and row[0] not in PICTURES]
    if counted:  # the order they were heard in, whatever order a tool has put them in since
        others.sort(key=lambda row: row[1].sequence)
    numbers = [-1, *(record.sequence for _, record in others)]
    gaps = frozenset(place for place in range(len(others)) if counted and numbers[place + 1] != numbers[place] + 1)
    return Recording(metadata, attachments, tuple(_decoded(others)), tuple(_frames(pictures)), gaps)


def _check_version(session: dict[str, str]) -> int:
    """The version of the layout. Raises BadRecording when it is newer than this one."""
    version = int(session.get("version", "1"))
    if version > VERSION:
        raise BadRecording(f"is of layout {version}, this viewsep reads up to {VERSION}: update viewsep")
    return version


def _check_channel(channel: Channel, schema: Schema | None) -> None:
    """Raise BadRecording unless the channel is not ours or carries our schema."""
    expected = SCHEMAS.get(channel.topic)
    if expected is None:
        return
    name = expected.DESCRIPTOR.full_name
    if schema is None:
        raise BadRecording(f"topic {channel.topic!r} has no schema, {name} is needed; record again")
    if (schema.name, schema.encoding, channel.message_encoding) != (name, "protobuf", "protobuf"):
        raise BadRecording(f"topic {channel.topic!r} holds {schema.name} ({schema.encoding}), not {name}; record again")


def _decoded(records: Iterable[tuple[str, Message]]) -> Iterator[Recorded]:
    """The messages in order."""
    for topic, record in records:
        with _named(topic, record):
            message = decode(topic, _protobuf(topic, record.data))
            yield Recorded(topic, record.log_time, message, record.data, record.sequence)


def _frames(records: Iterable[tuple[str, Message]]) -> Iterator[RecordedFrame]:
    """The pictures in order, each joined to the mask before it."""
    mask: tuple[Message, CompressedImage] | None = None
    for topic, record in records:
        with _named(topic, record):
            image = _protobuf(topic, record.data)
            assert isinstance(image, CompressedImage)
            if mask is not None and (topic, record.sequence) != (IMAGE_TOPIC, mask[0].sequence):
                raise BadRecording(f"the mask of frame {mask[0].sequence} is not followed by its picture; record again")
            if topic == MASK_TOPIC:
                mask = record, image
                continue
            yield decode_frame(record.sequence, image, None if mask is None else mask[1])
        mask = None
    if mask is not None:
        raise BadRecording(f"the mask of frame {mask[0].sequence} is not followed by its picture; record again")


@contextmanager
def _named(topic: str, record: Message) -> Iterator[None]:
    """Errors about a message say which one."""
    try:
        yield
    except (BadRecording, DecodeError) as error:
        raise BadRecording(f"message {record.sequence} (topic {topic}, {record.log_time} ns): {error}") from error


def _protobuf(topic: str, data: bytes) -> Protobuf:
    """`data` as the topic's protobuf message, refused if something in it would be lost."""
    protobuf = SCHEMAS[topic].FromString(data)
    size = protobuf.ByteSize()
    protobuf.DiscardUnknownFields()
    if protobuf.ByteSize() != size:
        raise BadRecording(f"{protobuf.DESCRIPTOR.full_name} has a kind or field this version lacks; update viewsep")
    return protobuf
