"""A listener that writes what is recorded and, beside it, the scene, as the recorder does."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from google.protobuf.message import Message as Protobuf
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from viewsep.messages import Frame, HypothesisViews, Message
from viewsep.recordings.codec import encode, encode_frame, serialise
from viewsep.recordings.scene import Scene
from viewsep.recordings.units import UNITS


def written(stamp_ns: int, message: Message, scene: Scene) -> list[tuple[str, Protobuf]]:
    """What stands in a recording for a message: topics and protobuf messages in order."""
    if isinstance(message, Frame):
        return list(encode_frame(message))
    ours = [] if isinstance(message, HypothesisViews) else [encode(message)]
    return [*ours, *scene.show(stamp_ns, message)]


class Beside:
    """Writes everything it hears to the file at `path`. A context manager."""

    def __init__(self, path: Path, scene: Scene) -> None:
        self._path = path
        self._scene = scene
        self._channels: dict[str, int] = {}

    def __enter__(self) -> Beside:
        self._file: BinaryIO = self._path.open("wb")
        self._writer = Writer(self._file, enable_data_crcs=True)
        self._writer.start(profile="viewsep")
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def hear(self, stamp_ns: int, message: Message) -> None:
        for topic, protobuf in written(stamp_ns, message, self._scene):
            self._writer.add_message(self._channel(topic, protobuf), stamp_ns, serialise(protobuf), stamp_ns)

    def _channel(self, topic: str, protobuf: Protobuf) -> int:
        if topic not in self._channels:
            descriptors = build_file_descriptor_set(type(protobuf)).SerializeToString(deterministic=True)
            schema = self._writer.register_schema(protobuf.DESCRIPTOR.full_name, "protobuf", descriptors)
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema, dict(UNITS[topic]))
        return self._channels[topic]
