"""The golden recording, and others made of it by changing something."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from viewsep.messages import Message, PerceptReceived
from viewsep.recording import MODEL_MEDIA_TYPE
from viewsep.recordings import codec
from viewsep.recordings.reader import Recorded, Recording, read_recording
from viewsep.recordings.writer import Attachment, Recorder

GOLDEN = Path(__file__).parent / "golden" / "v1.mcap"
TRUTH = "product_7_twin_face"
USED = 33  # looks


@lru_cache(maxsize=1)
def golden() -> Recording:
    """Two look-alike boxes on a simulated gimbal: 33 of 66 looks were used, pictures are 80 x 80 pixels."""
    return read_recording(GOLDEN)


def where(recording: Recording, topic: str) -> list[int]:
    """Indices of the messages on a topic."""
    return [index for index, recorded in enumerate(recording.messages) if recorded.topic == topic]


def with_message(recording: Recording, index: int, change: Callable[[Message], Message]) -> Recording:
    """One message changed; whatever the codec cannot hold is refused."""
    before = recording.messages[index].message
    topic, protobuf = codec.encode(change(before))  # type: ignore[arg-type]
    now = Recorded(topic, recording.messages[index].stamp_ns, codec.decode(topic, protobuf), codec.serialise(protobuf))
    return replace(recording, messages=(*recording.messages[:index], now, *recording.messages[index + 1 :]))


def without_message(recording: Recording, index: int) -> Recording:
    """One message taken out."""
    return replace(recording, messages=(*recording.messages[:index], *recording.messages[index + 1 :]))


def until_look(recording: Recording, looks: int) -> Recording:
    """The recording as if it had ended after so many looks."""
    end = where(recording, "estimate")[looks - 1] + 1
    return replace(recording, messages=recording.messages[:end])


def with_metadata(recording: Recording, name: str, **changed: str) -> Recording:
    """Keys of one metadata record changed or added."""
    record = {**recording.metadata.get(name, {}), **changed}
    return replace(recording, metadata={**recording.metadata, name: record})


def write(
    recording: Recording, path: Path, attachments: Mapping[str, bytes] | None = None, *, pictures: Sequence[int] = ()
) -> Path:
    """The recording as a file, with no pictures but those of the given percepts (encoded anew)."""
    files = recording.attachments if attachments is None else attachments
    frames = {frame.stamp_ns: frame for frame in recording.frames}
    percepts = where(recording, "percept")
    shown = {percepts[number] for number in pictures}
    attached = [Attachment(name, MODEL_MEDIA_TYPE, data) for name, data in files.items()]
    with Recorder(path, recording.metadata, attached) as recorder:
        for index, recorded in enumerate(recording.messages):
            if index in shown:
                assert isinstance(recorded.message, PerceptReceived)
                recorder.hear(recorded.stamp_ns, frames[recorded.message.stamp_ns].decode())
            recorder.hear(recorded.stamp_ns, recorded.message)
    return path


def write_as_photos(path: Path) -> Path:
    """The recording as if its pictures, the last six of them, were photos."""
    config = json.loads(golden().metadata["config"]["json"])
    config["rig"] |= {"backend": "photos", "views_deg": [[0, 0]]}
    return write(with_metadata(golden(), "config", json=json.dumps(config)), path, pictures=range(60, 66))
