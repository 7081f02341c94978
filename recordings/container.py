"""An MCAP file, written record by record so that whatever stands on the disk can be read.

Pictures stand in chunks of their own, uncompressed, as they are compressed already; everything else in zstd chunks.
Schemas and channels stand before the chunks, so that losing one chunk costs only what was in it.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import BinaryIO, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC

CHUNK_BYTES = 256 * 1024
ZSTD, PLAIN = "zstd", ""
_FOOTER_START = struct.Struct("<BQQQ")  # opcode, length, summary start, summary offset start


class Writable(Protocol):
    """A record of the mcap package."""

    def write(self, stream: RecordBuilder) -> None:
        """Append itself."""
        ...


def record_bytes(*records: McapRecord | Writable) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


@dataclass
class _OpenChunk:
    compression: str
    parts: list[bytes] = field(default_factory=list)
    size: int = 0
    start_ns: int = 0
    end_ns: int = 0
    index: dict[int, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))

    def add(self, message: Message) -> None:
        data = record_bytes(message)
        self.start_ns = min(self.start_ns, message.log_time) if self.parts else message.log_time
        self.end_ns = max(self.end_ns, message.log_time)
        self.index[message.channel_id].append((message.log_time, self.size))
        self.parts.append(data)
        self.size += len(data)

    def close(self) -> Chunk:
        records = b"".join(self.parts)
        return Chunk(
            compression=self.compression,
            data=zstandard.compress(records) if self.compression == ZSTD else records,
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        )


class Container:
    """Writes to `file` from its beginning on; `written` counts the bytes. Every call may raise OSError."""

    def __init__(self, file: BinaryIO, profile: str, library: str = LIBRARY_IDENTIFIER) -> None:
        self.written = 0
        self._file = file
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._compression: dict[int, str] = {}
        self._open: dict[str, _OpenChunk] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._put(MCAP0_MAGIC + record_bytes(Header(profile=profile, library=library)))

    @property
    def size(self) -> int:
        """Bytes written and still open (uncompressed)."""
        return self.written + sum(chunk.size for chunk in self._open.values())

    def add_metadata(self, name: str, record: Mapping[str, str]) -> None:
        """A metadata record of keys and texts; may be given again, readers take the last one of a name."""
        start = self.written
        self._put(record_bytes(Metadata(name=name, metadata=dict(record))))
        self._metadata.append(MetadataIndex(offset=start, length=self.written - start, name=name))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """A file inside the file."""
        start = self.written
        self._put(record_bytes(Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)))
        self._attachments.append(
            AttachmentIndex(
                offset=start,
                length=self.written - start,
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_channel(
        self, topic: str, schema_name: str, schema: bytes, metadata: Mapping[str, str], *, compressed: bool
    ) -> int:
        """A channel of protobuf messages; `compressed` says in which chunks its messages stand. Returns its number."""
        known = self._schemas.get(schema_name)
        if known is None:
            known = Schema(id=len(self._schemas) + 1, data=schema, encoding="protobuf", name=schema_name)
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="protobuf",
            schema_id=known.id,
            metadata=dict(metadata),
        )
        self.copy_channel(known, channel, compressed=compressed)
        return channel.id

    def copy_channel(self, schema: Schema, channel: Channel, *, compressed: bool) -> None:
        """A channel as it stood in another file."""
        new = [] if schema.name in self._schemas else [schema]
        self._put(record_bytes(*new, channel))
        self._schemas[schema.name] = schema
        self._channels[channel.id] = channel
        self._compression[channel.id] = ZSTD if compressed else PLAIN

    def add_message(self, message: Message, *, goes_with_next: bool = False) -> None:
        """A message; it is on the disk after `close_chunks` or when its chunk is full.

        One that goes with the next one of its kind is never in another chunk than that.
        """
        compression = self._compression[message.channel_id]
        chunk = self._open.setdefault(compression, _OpenChunk(compression))
        chunk.add(message)
        if chunk.size >= CHUNK_BYTES and not goes_with_next:
            self._close_chunk(compression)

    def close_chunks(self) -> None:
        """Write what is open and flush."""
        for compression in list(self._open):
            self._close_chunk(compression)
        self._file.flush()

    def finish(self) -> None:
        """Complete the file with index, statistics and checksums, and flush; the file stays open."""
        self.close_chunks()
        data_end = record_bytes(DataEnd(self._crc))
        self._put(data_end)
        start = self.written
        groups = self._summary()
        offsets, position = [], start
        for group in groups:
            offsets.append(SummaryOffset(group_opcode=group[0], group_start=position, group_length=len(group[1])))
            position += len(group[1])
        summary = b"".join(data for _, data in groups) + record_bytes(*offsets)
        crc = zlib.crc32(_FOOTER_START.pack(Opcode.FOOTER, 8 + 8 + 4, start, position), zlib.crc32(summary))
        footer = record_bytes(Footer(summary_start=start, summary_offset_start=position, summary_crc=crc))
        self._put(summary + footer + MCAP0_MAGIC)
        self._file.flush()

    def _summary(self) -> list[tuple[Opcode, bytes]]:
        """What readers look things up in, group by group; groups without records are left out."""
        groups = [
            (Opcode.SCHEMA, record_bytes(*self._schemas.values())),
            (Opcode.CHANNEL, record_bytes(*self._channels.values())),
            (Opcode.STATISTICS, record_bytes(self._statistics())),
            (Opcode.CHUNK_INDEX, record_bytes(*self._chunks)),
            (Opcode.ATTACHMENT_INDEX, record_bytes(*self._attachments)),
            (Opcode.METADATA_INDEX, record_bytes(*self._metadata)),
        ]
        return [group for group in groups if group[1]]

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _close_chunk(self, compression: str) -> None:
        """The chunk and its message indexes in one go."""
        open_chunk = self._open.pop(compression)
        chunk = open_chunk.close()
        start = self.written
        data = record_bytes(chunk)
        offsets, length = {}, len(data)
        parts = [data]
        for channel, records in open_chunk.index.items():
            part = record_bytes(MessageIndex(channel_id=channel, records=records))
            offsets[channel] = start + length
            length += len(part)
            parts.append(part)
            self._counts[channel] += len(records)
        self._put(b"".join(parts))
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(data),
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=length - len(data),
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._crc = zlib.crc32(data, self._crc)
        self.written += len(data)
