"""Names on the wire: keys, encodings, and the attachment of every stream (design section 7)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message as Protobuf

from viewsep.recordings.codec import IMAGE_TOPIC, SCHEMAS

PREFIX = "viewsep"
STATUS_SCHEMA = "viewsep.status/1"
MANIFEST_SCHEMA = "viewsep.manifest/1"
LOG = "log"
RIG_STREAMS = ("motion/state", LOG)
ENGINE_STREAMS = ("percept", "event", "command", "estimate", "result", LOG)
STREAMS = tuple(dict.fromkeys((*RIG_STREAMS, *ENGINE_STREAMS)))
"""What is published besides pictures."""
PUBLISHED: Mapping[str, type[Protobuf]] = {
    topic: Log if topic == LOG else SCHEMAS[topic] for topic in (IMAGE_TOPIC, *STREAMS)
}
"""Everything that is published, and the protobuf message of each."""
JSON = "application/json"
_ATTACHMENT = struct.Struct("<Qq")


class Role(StrEnum):
    """What a serving process does."""

    RIG = "rig"  # holds motion and camera
    ENGINE = "engine"  # thinks and records


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one rig. `Keys("*")` selects those of all rigs."""

    rig: str

    def key(self, *parts: str) -> str:
        """`viewsep/{rig}/part/part`."""
        return "/".join((PREFIX, self.rig, *parts))

    @property
    def status(self) -> str:
        """Query: the state of all roles, JSON."""
        return self.key("status")

    @property
    def manifest(self) -> str:
        """Query: keys, schemas and versions, JSON."""
        return self.key("manifest")

    @property
    def image(self) -> str:
        """Stream: pictures, foxglove.CompressedImage."""
        return self.key(IMAGE_TOPIC)

    def command(self, name: str) -> str:
        """Query: a request, JSON in, JSON or an error out."""
        return self.key("cmd", name)

    def alive(self, role: str) -> str:
        """Liveliness: a role is served."""
        return self.key("alive", role)

    def lease(self, token: str) -> str:
        """Liveliness: whoever holds a lease with this token is still there."""
        return self.key("lease", token)

    def remote(self, call: str) -> str:
        """Query: one call of the rig's interfaces, from the engine's side to the rig's."""
        return self.key("rig", call)


def encoding(topic: str) -> str:
    """The encoding of a stream: protobuf, with the schema's name."""
    return f"application/protobuf;{PUBLISHED[topic].DESCRIPTOR.full_name}"


def attachment(sequence: int, stamp_ns: int) -> bytes:
    """Sequence number on the key and source time on the rig's clock: two 64-bit little-endian integers."""
    return _ATTACHMENT.pack(sequence, stamp_ns)


def read_attachment(data: bytes) -> tuple[int, int]:
    """Sequence and source time in nanoseconds. Raises ValueError when the bytes are no attachment of ours."""
    try:
        sequence, stamp_ns = _ATTACHMENT.unpack(data)
    except struct.error as error:
        raise ValueError(f"{len(data)} bytes are no attachment of {_ATTACHMENT.size}") from error
    return int(sequence), int(stamp_ns)
