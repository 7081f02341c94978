"""Writes a session to an MCAP file, in the order it was heard.

The file grows as `<name>.part` and takes its final name when it is complete, so a file under the final name can be
trusted. Single-threaded: `hear` compresses and writes before it returns.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from google.protobuf.message import Message as Protobuf
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from viewsep.errors import BadInput
from viewsep.messages import Frame, HypothesisViews, Message
from viewsep.recordings.codec import SCHEMAS, encode, encode_frame, serialise

SESSION = "session"
"""The metadata record with the wall-clock anchor; the recorder adds its keys to those the caller gives."""

_STAMP_END_NS = 2**63
_SEQUENCE_END = 2**32


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file kept inside a recording, such as a model or the configuration; `name` is unique in the recording."""

    name: str
    media_type: str
    data: bytes


class Recorder:
    """The listener that records everything it hears.

    `open()` writes `metadata` (records of keys and texts) and `attachments` to `<path>.part`; `close()` completes the
    file and renames it to `path`. As a context manager it does both, and it completes the file after an exception too:
    the recording of a failed task is precious. What could not be written completely (disk full) stays as `.part`.

    A recorder makes one recording. Its metadata record `session` gets `opened_unix_ns`, and with the first message the
    wall-clock anchor: at `anchor_unix_ns` (nanoseconds since 1970) the session's clock stood at `anchor_stamp_ns`.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Sequence[Attachment] = (),
        *,
        overwrite: bool = False,
    ) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        self._metadata = {name: dict(record) for name, record in metadata.items()}
        self._attachments = tuple(attachments)
        self._overwrite = overwrite
        self._file: BinaryIO | None = None
        self._broken = False
        self._anchored = False
        self._channels: dict[str, int] = {}
        self._heard: Counter[str] = Counter()

    def open(self) -> None:
        """Create the `.part` file and write what is known before the first message.

        Raises BadInput when the folder is missing or not writable, when the recording or its `.part` exists and
        `overwrite` is False, when two attachments share a name, and when a name or a metadata text is not Unicode.
        """
        if self._file is not None:
            raise RuntimeError("the recorder is open already")
        self._check_names()
        try:
            self._file = self._part.open("wb" if self._overwrite else "xb")
        except FileExistsError as error:
            raise BadInput(f"{self._part}: left by an unfinished recording; move it or record elsewhere") from error
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            self._start(self._file)
        except (OSError, UnicodeError) as error:
            self._drop()
            self._part.unlink(missing_ok=True)
            raise self._unwritable(error) from error

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Record `message` with log time `stamp_ns`; frames carry their own sequence number, others count per topic.

        Raises BadInput when the message cannot be recorded exactly (nothing of it is written then), or when the disk
        is full, after which nothing more is recorded.
        """
        if self._file is None:
            raise RuntimeError("the recorder is not open")
        if not 0 <= stamp_ns < _STAMP_END_NS:
            raise BadInput(f"{self.path}: a message at {stamp_ns} ns cannot be recorded; give a monotonic stamp")
        if isinstance(message, HypothesisViews):
            return
        if isinstance(message, Frame):
            if not (0 <= message.sequence < _SEQUENCE_END and 0 <= message.stamp_ns < _STAMP_END_NS):
                raise BadInput(f"{self.path}: frame {message.sequence} at {message.stamp_ns} ns is out of range")
            encoded: Sequence[tuple[str, Protobuf]] = encode_frame(message)
        else:
            encoded = (encode(message),)
        if self._broken:
            return
        try:
            self._anchor(stamp_ns)
            for topic, protobuf in encoded:
                sequence = message.sequence if isinstance(message, Frame) else self._heard[topic] % _SEQUENCE_END
                self._write(topic, stamp_ns, sequence, serialise(protobuf))
        except OSError as error:
            self._broken = True
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Complete the file and give it its final name. Safe to call twice.

        Raises BadInput when it cannot be completed or the final name has been taken meanwhile; the `.part` is kept.
        """
        if self._file is None:
            return
        if self._broken:
            self._drop()
            return
        try:
            if not self._anchored:
                self._writer.add_metadata(SESSION, self._session)
            self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves out "-> None"
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._broken = True
            raise self._unwritable(error) from error
        finally:
            self._drop()
        self._rename()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _check_names(self) -> None:
        if not self.path.parent.is_dir():
            raise BadInput(f"{self.path}: the folder {self.path.parent} does not exist; create it")
        if self.path.is_dir():
            raise BadInput(f"{self.path}: is a folder; give the name of a file")
        if self.path.exists() and not self._overwrite:
            raise BadInput(f"{self.path}: exists already; choose another name or overwrite it explicitly")
        names = Counter(attachment.name for attachment in self._attachments)
        for name, count in names.items():
            if count > 1:
                raise BadInput(f"{self.path}: {count} attachments are called {name!r}; give each its own name")

    def _start(self, file: BinaryIO) -> None:
        self._session = {**self._metadata.get(SESSION, {}), "opened_unix_ns": str(time.time_ns())}
        self._writer = Writer(file, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True)
        self._writer.start(profile="viewsep")
        for name, record in self._metadata.items():
            if name != SESSION:
                self._writer.add_metadata(name, record)
        for attachment in self._attachments:
            self._writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        file.flush()

    def _anchor(self, stamp_ns: int) -> None:
        if self._anchored:
            return
        self._anchored = True
        anchor = {"anchor_unix_ns": str(time.time_ns()), "anchor_stamp_ns": str(stamp_ns)}
        self._writer.add_metadata(SESSION, {**self._session, **anchor})

    def _write(self, topic: str, stamp_ns: int, sequence: int, data: bytes) -> None:
        if topic not in self._channels:
            schema = SCHEMAS[topic]
            descriptors = build_file_descriptor_set(schema).SerializeToString(deterministic=True)
            schema_id = self._writer.register_schema(schema.DESCRIPTOR.full_name, "protobuf", descriptors)
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema_id)
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, sequence)
        self._heard[topic] += 1

    def _rename(self) -> None:
        if self.path.exists() and not self._overwrite:
            raise BadInput(f"{self.path}: was created meanwhile; the recording is complete in {self._part}, rename it")
        try:
            self._part.replace(self.path)
        except OSError as error:
            raise self._unwritable(error) from error

    def _drop(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:
                self._broken = True  # the first error has been raised already

    def _unwritable(self, error: OSError | UnicodeError) -> BadInput:
        reason = error.strerror if isinstance(error, OSError) else error
        return BadInput(
            f"{self.path}: cannot be written ({reason}); make room and the folder writable, or move elsewhere"
        )
