"""Saving what is left of a recording that was never completed, cut off or damaged.

Every sound record is copied into a new file with an index, a summary and checksums of its own; the damaged file is
left as it is.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import DecodeError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, McapRecord, MessageIndex, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from viewsep.errors import BadInput, BadRecording
from viewsep.recordings.codec import MASK_TOPIC, PICTURES
from viewsep.recordings.container import Container
from viewsep.recordings.part_file import SUFFIX, PartFile, is_being_written
from viewsep.recordings.reader import check_bytes, read_bytes
from viewsep.recordings.scan import PARSE_ERRORS, RECORD, Damage, scan
from viewsep.recordings.version import RECOVERY

_SPAN = struct.Struct("<QQ")  # a chunk's first and last time


@dataclass(frozen=True, slots=True)
class Lost:
    """Bytes `start` to `end` of the damaged file. What of it is known: the time span (ns) and the messages by topic."""

    start: int
    end: int
    what: str
    span_ns: tuple[int, int] | None = None
    messages: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was saved from `source` into `path`: messages by topic, and their time span; and what was not.

    `already` is True when the file had been recovered before: nothing was written.
    """

    source: Path
    path: Path
    messages: dict[str, int]
    span_ns: tuple[int, int] | None
    lost: tuple[Lost, ...]
    already: bool


def told(saved: Recovered | None, source: Path) -> list[str]:
    """What became of `source`, in sentences."""
    if saved is None:
        return [f"{source} is whole: nothing to recover"]
    count = sum(saved.messages.values())
    span = f" over {_seconds(saved.span_ns):.1f} s" if saved.span_ns else ""
    how = "were saved before" if saved.already else "saved"
    lines = [f"{source}: {count} messages{span} {how} in {saved.path}"]
    for lost in saved.lost:
        line = f"lost: bytes {lost.start} to {lost.end}, a {lost.what}"
        if lost.messages:
            line += " with " + ", ".join(f"{number} on {topic}" for topic, number in sorted(lost.messages.items()))
        if lost.span_ns and saved.span_ns:
            first, last = ((stamp - saved.span_ns[0]) / 1e9 for stamp in lost.span_ns)
            line += f", from {first:.2f} s to {last:.2f} s"
        lines.append(line)
    return lines


def _seconds(span_ns: tuple[int, int]) -> float:
    return (span_ns[1] - span_ns[0]) / 1e9


def recovered_path(source: Path) -> Path:
    """Where what is saved of `source` goes: `run.mcap.part` and `run.mcap` both to `run.recovered.mcap`."""
    name = source.name.removesuffix(SUFFIX)
    stem = name.removesuffix(".mcap")
    return source.with_name(f"{stem}.recovered.mcap")


def recover(source: Path) -> Recovered | None:
    """Save what is left of `source` beside it; None when it is whole. The same file gives the same bytes again.

    Raises BadRecording when nothing can be saved, and BadInput when it is being written, or when the place of the
    recovered file is taken by another one.
    """
    if is_being_written(source):
        raise BadInput(f"{source}: is being written: nothing to recover as long as it is")
    data = read_bytes(source)
    try:
        check_bytes(data)
    except BadRecording:
        pass
    else:
        return None
    if not data.startswith(MCAP0_MAGIC):
        raise BadRecording(f"{source}: does not start as an MCAP file ({len(data)} bytes): there is nothing to save")
    saved = _sort_out(data)
    if not saved.messages and not saved.metadata:
        raise BadRecording(f"{source}: no record in it is sound: there is nothing to save")
    return _write(source, data, saved)


def unfinished(folder: Path) -> list[Path]:
    """The `.part` files in a folder that nobody is writing and that were not recovered before."""
    left = sorted(folder.glob(f"*.mcap{SUFFIX}"))
    return [part for part in left if not is_being_written(part) and not _is_recovered(part)]


@dataclass
class _Loss:
    """A damaged piece; `messages` counts by channel what the indexes after it say was in it."""

    damage: Damage
    span_ns: tuple[int, int] | None
    messages: Counter[int] = field(default_factory=Counter)


@dataclass
class _Saved:
    """The sound records of a file."""

    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[McapMessage] = field(default_factory=list)
    losses: list[_Loss] = field(default_factory=list)

    def keep(self, record: McapRecord) -> None:
        match record:
            case Metadata():
                self.metadata.append(record)
            case Attachment():
                self.attachments.append(record)
            case Schema(id=number):
                self.schemas[number] = record
            case Channel(id=number):
                self.channels[number] = record
            case McapMessage():
                self.messages.append(record)
            case Chunk():
                for inner in breakup_chunk(record):
                    self.keep(inner)

    def topic(self, channel: int) -> str:
        known = self.channels.get(channel)
        return known.topic if known else f"channel {channel}"


def _sort_out(data: bytes) -> _Saved:
    """What of a file is sound, and what is not."""
    saved = _Saved()
    damaged: _Loss | None = None
    for piece in scan(data):
        if isinstance(piece, Damage):
            damaged = _Loss(piece, _span(data, piece))
            saved.losses.append(damaged)
        elif isinstance(piece.record, MessageIndex):
            if damaged is not None:
                damaged.messages[piece.record.channel_id] += len(piece.record.records)
        else:
            damaged = None
            saved.keep(piece.record)
    orphans = Counter(message.channel_id for message in saved.messages if message.channel_id not in saved.channels)
    for loss in saved.losses:
        if loss.damage.what in ("channel", "schema"):
            loss.messages.update(orphans)
            orphans = Counter()
    saved.messages = [message for message in saved.messages if _schema_of(saved, message.channel_id)]
    return saved


def _schema_of(saved: _Saved, channel: int) -> Schema | None:
    """The schema of a channel, if both were saved."""
    known = saved.channels.get(channel)
    return saved.schemas.get(known.schema_id) if known else None


def _span(data: bytes, damage: Damage) -> tuple[int, int] | None:
    """The time span that a damaged chunk's header tells, if it is one and makes sense."""
    start = damage.start + RECORD.size
    if damage.what != "chunk" or start + _SPAN.size > len(data):
        return None
    first, last = _SPAN.unpack_from(data, start)
    return (first, last) if 0 < first <= last < 2**63 else None


def _write(source: Path, data: bytes, saved: _Saved) -> Recovered:
    """The saved records as a file of their own, unless that is there already."""
    origin = {"source": source.name, "source_bytes": str(len(data)), "source_crc32": f"{zlib.crc32(data):08x}"}
    path = recovered_path(source)
    already = path.exists() and _origin(path) == origin
    if path.exists() and not already:
        raise BadInput(f"{path}: is there already, but is not what was saved of {source}; move it away")
    if not already:
        part = PartFile(path, overwrite=False)
        try:
            container = Container(part.open(), "viewsep")
            _fill(container, saved, origin)
            part.complete()
        except OSError as error:
            part.remove()
            raise part.unwritable(error) from error
    return _recovered(source, path, saved, already)


def _fill(container: Container, saved: _Saved, origin: Mapping[str, str]) -> None:
    for metadata in saved.metadata:
        if metadata.name != RECOVERY:
            container.add_metadata(metadata.name, metadata.metadata)
    container.add_metadata(RECOVERY, origin)
    for attachment in saved.attachments:
        container.add_attachment(attachment.name, attachment.media_type, attachment.data)
    for channel in saved.channels.values():
        schema = _schema_of(saved, channel.id)
        if schema:
            container.copy_channel(schema, channel, compressed=channel.topic not in PICTURES)
    for message in saved.messages:
        container.add_message(message, goes_with_next=saved.topic(message.channel_id) == MASK_TOPIC)
    container.finish()


def _recovered(source: Path, path: Path, saved: _Saved, already: bool) -> Recovered:
    times = [message.log_time for message in saved.messages]
    return Recovered(
        source=source,
        path=path,
        messages=dict(Counter(saved.topic(message.channel_id) for message in saved.messages)),
        span_ns=(min(times), max(times)) if times else None,
        lost=tuple(
            Lost(
                loss.damage.start,
                loss.damage.end,
                loss.damage.what,
                loss.span_ns,
                {saved.topic(channel): count for channel, count in loss.messages.items()},
            )
            for loss in saved.losses
        ),
        already=already,
    )


def _is_recovered(part: Path) -> bool:
    """Whether what is left of a `.part` was saved before, as it is now."""
    origin = _origin(recovered_path(part))
    return origin is not None and origin["source"] == part.name and origin["source_bytes"] == str(part.stat().st_size)


def _origin(path: Path) -> dict[str, str] | None:
    """What a recovered file says of the file it was saved from."""
    try:
        with path.open("rb") as file:
            records = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    except (OSError, DecodeError, *PARSE_ERRORS):
        return None
    return records.get(RECOVERY)
