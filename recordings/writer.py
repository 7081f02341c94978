"""Writes a session to MCAP files, in the order it was heard, so that a crash loses no more than the last moments."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from google.protobuf.message import Message as Protobuf
from mcap.records import Message as McapMessage
from mcap_protobuf.schema import build_file_descriptor_set

from viewsep.config import RecordingConfig
from viewsep.errors import BadInput
from viewsep.messages import Frame, HypothesisViews, Keyframe, Message
from viewsep.recordings.codec import MASK_TOPIC, PICTURES, encode, encode_frame, serialise
from viewsep.recordings.container import Container
from viewsep.recordings.part_file import PartFile
from viewsep.recordings.units import UNITS
from viewsep.recordings.version import VERSION

SESSION = "session"
"""The metadata record with the wall-clock anchor; the recorder adds its keys to those the caller gives."""

_STAMP_END_NS = 2**63
_SEQUENCE_END = 2**32
_MB = 1_000_000


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file kept inside a recording, such as a model or the configuration; `name` is unique in the recording."""

    name: str
    media_type: str
    data: bytes


class Companions(Protocol):
    """Standard messages that are recorded beside ours, for viewers that do not know ours."""

    def show(self, stamp_ns: int, message: Message) -> Iterable[tuple[str, Protobuf]]:
        """What to record beside `message`: topics and messages."""
        ...


class Recorder:
    """The listener that records everything it hears. Not for several threads: `viewsep.recording` gives it its own.

    `open()` writes `metadata` (records of keys and texts) and `attachments` to `<path>.part`; `close()` completes the
    file and renames it to `path`. As a context manager it does both, and it completes the file after an exception too:
    the recording of a failed task is precious. What could not be written completely (disk full) stays as `.part`.

    Every `sync_s` what was heard is on the disk. When a file has reached its size or age, the next keyframe begins a
    new one, `<name>-2.mcap` and so on, with metadata and attachments of its own: each can be replayed alone. Where no
    keyframes are kept, any message does, and the files can only be replayed together.

    The metadata record `session` gets `opened_unix_ns` and with the first message the wall-clock anchor: at
    `anchor_unix_ns` (nanoseconds since 1970) the session's clock stood at `anchor_stamp_ns`. `lost` counts messages
    that were not passed on to it; whoever knows sets it before `close()`.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Sequence[Attachment] = (),
        *,
        settings: RecordingConfig | None = None,
        companions: Companions | None = None,
        overwrite: bool = False,
    ) -> None:
        self.paths = [path]
        self.lost = 0
        self._metadata = {name: dict(record) for name, record in metadata.items()}
        self._attachments = tuple(attachments)
        self._settings = settings or RecordingConfig()
        self._companions = companions
        self._overwrite = overwrite
        self._part: PartFile | None = None
        self._ended = False
        self._heard = 0
        self._opened_unix_ns = 0
        self._began = self._sync_due = time.monotonic()

    @property
    def path(self) -> Path:
        """The file that is being written, or was last."""
        return self.paths[-1]

    def open(self) -> None:
        """Create the `.part` file and write what is known before the first message.

        Raises BadInput when the folder is missing or not writable, when too little of the disk is left, when the
        recording or its `.part` exists and `overwrite` is False, when another process is writing it, when two
        attachments share a name, and when a name or a metadata text is not Unicode.
        """
        if self._part is not None:
            raise RuntimeError("the recorder is open already")
        for name, count in Counter(attachment.name for attachment in self._attachments).items():
            if count > 1:
                raise BadInput(f"{self.path}: {count} attachments are called {name!r}; give each its own name")
        self._opened_unix_ns = time.time_ns()
        self._begin_file()

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Record `message` with log time `stamp_ns`.

        Raises BadInput when the message cannot be recorded exactly (nothing of it is written then), or when the disk
        is full, after which nothing more is recorded.
        """
        if self._part is None and not self._ended:
            raise RuntimeError("the recorder is not open")
        if not 0 <= stamp_ns < _STAMP_END_NS:
            raise BadInput(f"{self.path}: a message at {stamp_ns} ns cannot be recorded; give a monotonic stamp")
        encoded = self._encoded(message)
        if self._ended:
            return
        begins = isinstance(message, Keyframe) or self._settings.keyframe_s == 0
        if begins and self._file_is_full():
            self._begin_next_file()
        try:
            self._anchor(stamp_ns)
            for topic, protobuf, sequence in encoded:
                self._write(topic, stamp_ns, sequence, protobuf)
            if self._companions is not None:
                for topic, protobuf in self._companions.show(stamp_ns, message):
                    self._write(topic, stamp_ns, 0, protobuf)
        except OSError as error:
            raise self._failed(error) from error
        self.tick()

    def tick(self) -> None:
        """Put what was heard on the disk when it is time; call it now and then while nothing is heard.

        Raises BadInput when the disk is full, or nearly so: the recording is complete then, but ends.
        """
        if self._part is None or time.monotonic() < self._sync_due:
            return
        self._sync_due = time.monotonic() + self._settings.sync_s
        try:
            self._container.close_chunks()
            self._part.sync()
            free = self._part.free_bytes()
        except OSError as error:
            raise self._failed(error) from error
        if free < self._settings.min_free_mb * _MB:
            self._ended = True
            self.close()
            raise BadInput(f"{self.path}: recording has ended, as {self._too_little(free)}; what it holds is complete")

    def close(self) -> None:
        """Complete the file and give it its final name. Safe to call twice.

        Raises BadInput when it cannot be completed or the final name has been taken meanwhile; the `.part` is kept.
        """
        part = self._part
        if part is None:
            return
        self._part, self._ended = None, True
        try:
            if not self._anchored:
                self._container.add_metadata(SESSION, self._session)
            if self.lost:
                self._container.add_metadata("lost", {"messages": str(self.lost)})
            self._container.finish()
            part.complete()
        except OSError as error:
            raise part.unwritable(error) from error
        finally:
            part.drop()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _begin_file(self) -> None:
        part = PartFile(self.path, overwrite=self._overwrite)
        file = part.open()
        try:
            free = part.free_bytes()
            if free < self._settings.min_free_mb * _MB:
                raise BadInput(f"{self.path}: cannot be recorded, as {self._too_little(free)}")
            self._container = Container(file, "viewsep")
            for name, record in self._metadata.items():
                if name != SESSION:
                    self._container.add_metadata(name, record)
            for attachment in self._attachments:
                self._container.add_attachment(attachment.name, attachment.media_type, attachment.data)
            file.flush()
        except (OSError, UnicodeError) as error:
            part.remove()
            raise part.unwritable(error) from error
        except BadInput:
            part.remove()
            raise
        self._part = part
        self._anchored = False
        self._channels: dict[str, int] = {}
        self._session = {
            **self._metadata.get(SESSION, {}),
            "version": str(VERSION),
            "opened_unix_ns": str(self._opened_unix_ns),
            "part": str(len(self.paths)),
        }
        self._began = time.monotonic()
        self._sync_due = self._began + self._settings.sync_s

    def _file_is_full(self) -> bool:
        settings = self._settings
        large = settings.rotate_mb and self._container.size >= settings.rotate_mb * _MB
        old = settings.rotate_s and time.monotonic() - self._began >= settings.rotate_s
        return bool(large or old)

    def _begin_next_file(self) -> None:
        """Complete this file and go on in the next one."""
        first = self.paths[0]
        self.close()
        self.paths.append(first.with_name(f"{first.stem}-{len(self.paths) + 1}{first.suffix}"))
        try:
            self._begin_file()
        except BadInput:
            self.paths.pop()
            raise
        self._ended = False

    def _encoded(self, message: Message) -> list[tuple[str, Protobuf, int]]:
        """Topics, messages and their sequence numbers: a frame's own, all others are counted together."""
        if isinstance(message, HypothesisViews):
            return []
        if isinstance(message, Frame):
            if not (0 <= message.sequence < _SEQUENCE_END and 0 <= message.stamp_ns < _STAMP_END_NS):
                raise BadInput(f"{self.path}: frame {message.sequence} at {message.stamp_ns} ns is out of range")
            return [(topic, protobuf, message.sequence) for topic, protobuf in encode_frame(message)]
        topic, protobuf = encode(message)
        self._heard += 1
        return [(topic, protobuf, (self._heard - 1) % _SEQUENCE_END)]

    def _anchor(self, stamp_ns: int) -> None:
        if self._anchored:
            return
        self._anchored = True
        anchor = {"anchor_unix_ns": str(time.time_ns()), "anchor_stamp_ns": str(stamp_ns)}
        self._container.add_metadata(SESSION, {**self._session, **anchor})

    def _write(self, topic: str, stamp_ns: int, sequence: int, protobuf: Protobuf) -> None:
        if topic not in self._channels:
            descriptors = build_file_descriptor_set(type(protobuf)).SerializeToString(deterministic=True)
            name, units = protobuf.DESCRIPTOR.full_name, UNITS.get(topic, {})
            self._channels[topic] = self._container.add_channel(
                topic, name, descriptors, units, compressed=topic not in PICTURES
            )
        record = McapMessage(self._channels[topic], stamp_ns, serialise(protobuf), stamp_ns, sequence)
        self._container.add_message(record, goes_with_next=topic == MASK_TOPIC)

    def _failed(self, error: OSError) -> BadInput:
        """Give up: the `.part` stays as it is on the disk."""
        assert self._part is not None
        part, self._part = self._part, None
        self._ended = True
        part.drop()
        return part.unwritable(error)

    def _too_little(self, free: int) -> str:
        return (
            f"only {free / _MB:.0f} MB of the disk are left (key 'recording.min_free_mb' = "
            f"{self._settings.min_free_mb:g}): make room or record elsewhere"
        )
