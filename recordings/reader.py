"""Reads a recording back, in file order, and notices any changed byte.

Every byte of a recording stands under a CRC32: the data section under the one in its DataEnd record, the summary and
the footer under the one in the footer. mcap's readers check the first only on request and the second never, so both
are checked here before anything is parsed; both magics and the records between them are at fixed places.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
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

_RECORD = struct.Struct("<BQ")  # opcode, length
_DATA_END = struct.Struct("<BQI")  # opcode, length, CRC of everything before
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, CRC of summary and footer
_PARSE_ERRORS = (McapError, DecodeError, zstandard.ZstdError, struct.error, ValueError)


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as it was heard at `stamp_ns`; `raw` is its recorded protobuf."""

    topic: str
    stamp_ns: int
    message: Recordable
    raw: bytes


@dataclass(frozen=True, slots=True)
class Recording:
    """A whole recording: metadata records by name, attachments' bytes by name, messages in the order they were heard.

    `frames` are the pictures, still compressed, in their own order; a percept belongs to the frame with its stamp.
    """

    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    messages: tuple[Recorded, ...]
    frames: tuple[RecordedFrame, ...]


def read_recording(path: Path) -> Recording:
    """Everything in the recording at `path`.

    Raises BadRecording when the file is missing, is not MCAP, is truncated or changed in any byte, or holds a topic,
    schema, kind of event or field that this version does not know.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise BadRecording(f"{path}: no such file; check the name") from error
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read ({error.strerror}); give a recording's file") from error
    try:
        _check_bytes(data)
        return _parse(data)
    except BadRecording as error:
        raise BadRecording(f"{path}: {error}") from error
    except _PARSE_ERRORS as error:
        raise BadRecording(f"{path}: its records make no sense ({error}); it was not written by viewsep") from error


def _check_bytes(data: bytes) -> None:
    """Raise BadRecording unless magics, DataEnd and footer stand where they belong and every byte matches its CRC."""
    if not data:
        raise BadRecording("is empty; record again")
    if not data.startswith(MCAP0_MAGIC):
        raise BadRecording(f"does not start as an MCAP file (first bytes {data[:8].hex()}); give a recording")
    footer_start = len(data) - len(MCAP0_MAGIC) - _FOOTER.size
    if footer_start < len(MCAP0_MAGIC) or not data.endswith(MCAP0_MAGIC):
        raise BadRecording(f"does not end as an MCAP file after {len(data)} bytes: truncated; take a whole copy")
    opcode, length, summary_start, _, summary_crc = _FOOTER.unpack_from(data, footer_start)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - _RECORD.size):
        raise BadRecording(f"has no footer at byte {footer_start}: damaged; take a whole copy")
    data_end = summary_start - _DATA_END.size
    summary = memoryview(data)[summary_start : footer_start + _FOOTER.size - 4]
    if summary_start > footer_start or data_end < 0 or zlib.crc32(summary) != summary_crc:
        raise BadRecording(f"its summary and footer up to byte {len(data)} do not match their CRC; take a whole copy")
    opcode, length, data_crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, _DATA_END.size - _RECORD.size):
        raise BadRecording(f"its data section does not end at byte {data_end}: damaged; take a whole copy")
    if zlib.crc32(memoryview(data)[:data_end]) != data_crc:
        if data_crc == 0:
            raise BadRecording("carries no CRC of its data section: rewritten by another tool; give the original file")
        raise BadRecording(f"{_damaged_part(data, data_end)} does not match its CRC; take a whole copy")


def _damaged_part(data: bytes, data_end: int) -> str:
    """The first record of the damaged data section whose own CRC fails, for the message."""
    position = len(MCAP0_MAGIC)
    while position + _RECORD.size <= data_end:
        opcode, length = _RECORD.unpack_from(data, position)
        end = position + _RECORD.size + length
        if end > data_end:
            break
        record = data[position:end]
        if opcode == Opcode.CHUNK and not _chunk_is_sound(record):
            return f"its chunk at byte {position}"
        if opcode == Opcode.ATTACHMENT and not _attachment_is_sound(record):
            return f"its attachment at byte {position}"
        position = end
    return f"its data section (bytes 0 to {data_end})"


def _chunk_is_sound(record: bytes) -> bool:
    try:
        breakup_chunk(Chunk.read(ReadDataStream(BytesIO(record[_RECORD.size :]))), validate_crc=True)
    except (*_PARSE_ERRORS, MemoryError, OverflowError):
        return False
    return True


def _attachment_is_sound(record: bytes) -> bool:
    return zlib.crc32(record[_RECORD.size : -4]) == int.from_bytes(record[-4:], "little")


def _parse(data: bytes) -> Recording:
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
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
                topics[number] = _checked_topic(record, schemas.get(record.schema_id))
            case Message(channel_id=number):
                if number not in topics:
                    raise BadRecording(f"a message at {record.log_time} ns is on channel {number}, which is not there")
                messages.append((topics[number], record))
    pictures = [row for row in messages if row[0] in PICTURES]
    others = [row for row in messages if row[0] not in PICTURES]
    return Recording(metadata, attachments, tuple(_decoded(others)), tuple(_frames(pictures)))


def _checked_topic(channel: Channel, schema: Schema | None) -> str:
    """The channel's topic, if it is one of ours and carries its schema."""
    expected = SCHEMAS.get(channel.topic)
    if expected is None:
        raise BadRecording(f"topic {channel.topic!r} is unknown to this version; update viewsep")
    name = expected.DESCRIPTOR.full_name
    if schema is None:
        raise BadRecording(f"topic {channel.topic!r} has no schema, {name} is needed; record again")
    if (schema.name, schema.encoding, channel.message_encoding) != (name, "protobuf", "protobuf"):
        raise BadRecording(f"topic {channel.topic!r} holds {schema.name} ({schema.encoding}), not {name}; record again")
    return channel.topic


def _decoded(records: Iterable[tuple[str, Message]]) -> Iterator[Recorded]:
    """The messages in order."""
    for topic, record in records:
        with _named(topic, record):
            yield Recorded(topic, record.log_time, decode(topic, _protobuf(topic, record.data)), record.data)


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
