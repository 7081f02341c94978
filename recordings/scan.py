"""A recording record by record, whatever has happened to it: what is sound, and where it is damaged.

Chunks and attachments carry a CRC of their own; of the other records it is checked that they make sense.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, MessageIndex, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

RECORD = struct.Struct("<BQ")  # opcode, length
PARSE_ERRORS = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError)

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
# an opcode and a length below 4 GB: what may be the beginning of a record
_MAY_BEGIN = re.compile(b"[" + re.escape(bytes(_KINDS)) + rb"].{4}\x00{4}", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Sound:
    """A record that can be used, at bytes `start` to `end`."""

    start: int
    end: int
    record: McapRecord


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes `start` to `end` that cannot be used; `what` is what they seem to be, such as `chunk`."""

    start: int
    end: int
    what: str


def scan(data: bytes | memoryview) -> Iterator[Sound | Damage]:
    """Everything in the data section up to its end or the file's. The first piece starts after the magic."""
    view = memoryview(data)
    position = len(MCAP0_MAGIC)
    while position < len(view):
        piece = _record_at(view, position) or _damage_at(view, position)
        yield piece
        position = piece.end
        if isinstance(piece, Sound) and isinstance(piece.record, DataEnd):
            return


def _record_at(view: memoryview, start: int) -> Sound | None:
    """The record that begins at `start`, if it is sound."""
    end = _end_of(view, start)
    if end is None:
        return None
    opcode = view[start]
    body = bytes(view[start + RECORD.size : end])
    try:
        record = _parse(opcode, body)
        if isinstance(record, Chunk):
            breakup_chunk(record, validate_crc=True)
        if isinstance(record, Attachment) and zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
            return None
    except PARSE_ERRORS:
        return None
    return Sound(start, end, record)


def _end_of(view: memoryview, start: int) -> int | None:
    """Where the record at `start` ends, if there can be one."""
    if start + RECORD.size > len(view) or view[start] not in _KINDS:
        return None
    end: int = start + RECORD.size + RECORD.unpack_from(view, start)[1]
    return end if end <= len(view) else None


def _parse(opcode: int, body: bytes) -> McapRecord:
    """The record, if it is exactly as long as it says."""
    stream = ReadDataStream(BytesIO(body))
    record: McapRecord = _KINDS[opcode].read(stream)
    if stream.count != len(body):
        raise ValueError("it is longer than what is in it")
    return record


def _damage_at(view: memoryview, start: int) -> Damage:
    """Up to the next sound record: that which follows by the length, otherwise the first that can be found."""
    what = _KINDS[view[start]].__name__.lower() if view[start] in _KINDS else "record"
    end = _end_of(view, start)
    if end is not None and (end == len(view) or _record_at(view, end)):
        return Damage(start, end, what)
    for match in _MAY_BEGIN.finditer(view, start + 1):
        if _record_at(view, match.start()):
            return Damage(start, match.start(), what)
    return Damage(start, len(view), what)
