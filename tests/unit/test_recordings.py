"""A recording comes back in the order it was heard, and no changed byte goes unnoticed."""

from __future__ import annotations

import errno
import io
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from viewsep import messages as m
from viewsep.errors import BadInput, BadRecording
from viewsep.recordings import codec
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.schemas import viewsep_pb2 as pb
from viewsep.recordings.writer import Attachment, Recorder

VIEW = np.array([0.0, 0.6, 0.8])
IMAGE = np.arange(8 * 12 * 3, dtype=np.uint8).reshape(8, 12, 3)
MASK = np.eye(8, 12, dtype=np.bool_)
METADATA = {"session": {"rig": "gimbal"}, "versions": {"viewsep": "0.1.0", "numpy": "2"}}
ATTACHMENTS = (Attachment("model.npz", "application/octet-stream", bytes(range(256))), Attachment("empty", "", b""))

HEARD: tuple[tuple[int, m.Message], ...] = (
    (100, m.TaskStarted(90, 7, VIEW)),
    (100, m.MoveTo(1, VIEW, m.Phase.STARTING)),
    (300, m.JointState(300, (0.1, -0.0), (0.2, 0.0), True)),
    (350, m.Frame(340, 41, IMAGE, MASK)),
    (250, m.MoveSettled(240, 1)),
    (400, m.Frame(390, 43, IMAGE, None)),
    (400, m.PerceptReceived(m.Percept(340, 41, "cch", np.ones(5, np.float32), VIEW))),
    (400, m.Estimate(400, 1, m.Phase.EXPLORING, (), 12, 0.5, None)),
    (500, m.Result(500, m.Outcome.UNDECIDED, "", "budget spent", (("a", 1.5),), np.eye(3), 1, 0.5, 12)),
)


def record(path: Path, heard: tuple[tuple[int, m.Message], ...] = HEARD) -> Path:
    with Recorder(path, METADATA, ATTACHMENTS) as recorder:
        for stamp_ns, message in heard:
            recorder.hear(stamp_ns, message)
    return path


def content(recording: Recording) -> tuple[Any, ...]:
    """What a recording holds, so that it can be compared with `told`."""
    return (
        [(r.stamp_ns, codec.to_bytes(r.message)) for r in recording.messages],
        [(frame.stamp_ns, frame.sequence, frame.mask_png is None) for frame in recording.frames],
    )


def told(heard: tuple[tuple[int, m.Message], ...]) -> tuple[Any, ...]:
    """What a recording of `heard` must hold: messages in order, pictures in order."""
    frames = [h for _, h in heard if isinstance(h, m.Frame)]
    return (
        [(t, codec.to_bytes(h)) for t, h in heard if not isinstance(h, m.Frame | m.HypothesisViews)],
        [(frame.stamp_ns, frame.sequence, frame.mask is None) for frame in frames],
    )


def test_everything_comes_back_in_the_order_it_was_heard(tmp_path: Path) -> None:
    recording = read_recording(record(tmp_path / "a.mcap"))
    assert content(recording) == told(HEARD)
    assert recording.attachments == {a.name: a.data for a in ATTACHMENTS}
    assert recording.metadata["versions"] == METADATA["versions"]
    assert not (tmp_path / "a.mcap.part").exists()


def test_raw_is_the_recorded_protobuf(tmp_path: Path) -> None:
    for recorded in read_recording(record(tmp_path / "a.mcap")).messages:
        assert recorded.raw == codec.to_bytes(recorded.message)
        assert recorded.topic == codec.encode(recorded.message)[0]


def test_frames_come_back_with_their_masks(tmp_path: Path) -> None:
    masked, bare = (frame.decode() for frame in read_recording(record(tmp_path / "a.mcap")).frames)
    assert masked.image.shape == IMAGE.shape
    assert masked.mask is not None
    assert (masked.mask == MASK).all()
    assert bare.mask is None


def test_the_session_has_a_wall_clock_anchor(tmp_path: Path) -> None:
    before = time.time_ns()
    session = read_recording(record(tmp_path / "a.mcap")).metadata["session"]
    assert session["rig"] == "gimbal"
    assert before <= int(session["opened_unix_ns"]) <= int(session["anchor_unix_ns"]) <= time.time_ns()
    assert session["anchor_stamp_ns"] == "100"


def test_foreign_readers_see_times_sequences_and_schemas(tmp_path: Path) -> None:
    with record(tmp_path / "a.mcap").open("rb") as file:
        rows = list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))
    assert all(message.log_time == message.publish_time for _, _, message in rows)
    assert [(channel.topic, message.sequence) for _, channel, message in rows] == [
        ("event", 0),
        ("command", 1),
        ("motion/state", 2),
        ("event", 3),
        ("percept", 4),
        ("estimate", 5),
        ("result", 6),
        ("camera/mask", 41),
        ("camera/image", 41),
        ("camera/image", 43),
    ]
    for schema, channel, _ in rows:
        assert schema is not None
        assert schema.name == codec.SCHEMAS[channel.topic].DESCRIPTOR.full_name


def test_attachments_and_metadata_stand_at_the_start(tmp_path: Path) -> None:
    data = record(tmp_path / "a.mcap").read_bytes()
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    before_chunks = [index.offset for index in summary.attachment_indexes]
    before_chunks += [index.offset for index in summary.metadata_indexes]
    assert len(before_chunks) == 4
    assert max(before_chunks) < min(index.chunk_start_offset for index in summary.chunk_indexes)
    assert [index.compression for index in summary.chunk_indexes] == ["zstd", ""]  # pictures are compressed already


def test_order_holds_over_many_chunks(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3), np.uint8)
    heard = tuple((1000 - i % 7, m.Frame(i, i, noise, None) if i % 2 else m.DeadlinePassed(i)) for i in range(80))
    recording = read_recording(record(tmp_path / "a.mcap", heard))
    assert content(recording) == told(heard)
    summary = make_reader(io.BytesIO((tmp_path / "a.mcap").read_bytes())).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 2


def test_a_recording_of_nothing_is_valid(tmp_path: Path) -> None:
    recording = read_recording(record(tmp_path / "a.mcap", ()))
    assert recording.messages == ()
    assert "anchor_unix_ns" not in recording.metadata["session"]


def test_the_constructor_touches_nothing(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, ())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RuntimeError, match="not open"):
        recorder.hear(0, m.DeadlinePassed(0))


def test_the_final_name_appears_only_when_complete(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, ())
    recorder.open()
    recorder.hear(1, m.DeadlinePassed(1))
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.part"]
    recorder.close()
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_a_failed_task_leaves_a_valid_recording(tmp_path: Path) -> None:
    def fail() -> None:
        with Recorder(tmp_path / "a.mcap", {}, ()) as recorder:
            recorder.hear(1, m.DeadlinePassed(1))
            raise KeyError("task")

    with pytest.raises(KeyError, match="task"):
        fail()
    assert len(read_recording(tmp_path / "a.mcap").messages) == 1


def test_a_message_that_cannot_be_recorded_leaves_no_trace(tmp_path: Path) -> None:
    frame = m.Frame(0, 1, IMAGE, np.ones((1, 1), np.bool_))
    with Recorder(tmp_path / "a.mcap", {}, ()) as recorder:
        recorder.hear(1, m.DeadlinePassed(1))
        for stamp_ns, message in ((2, frame), (-1, m.DeadlinePassed(1)), (3, m.Frame(0, 2**32, IMAGE, None))):
            with pytest.raises(BadInput):
                recorder.hear(stamp_ns, message)
        recorder.hear(4, m.DeadlinePassed(4))
    assert [r.stamp_ns for r in read_recording(tmp_path / "a.mcap").messages] == [1, 4]


def test_an_existing_recording_is_not_overwritten_unasked(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    data = path.read_bytes()
    with pytest.raises(BadInput, match=r"a\.mcap: exists already"):
        Recorder(path, {}, ()).open()
    assert path.read_bytes() == data
    with Recorder(path, {}, (), overwrite=True):
        assert path.read_bytes() == data
    assert read_recording(path).messages == ()


def test_an_unfinished_recording_is_not_overwritten_unasked(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.part").write_bytes(b"precious")
    with pytest.raises(BadInput, match=r"a\.mcap\.part: left by an unfinished"):
        Recorder(tmp_path / "a.mcap", {}, ()).open()
    assert (tmp_path / "a.mcap.part").read_bytes() == b"precious"


def test_a_name_taken_meanwhile_is_kept(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, ())
    recorder.open()
    (tmp_path / "a.mcap").write_bytes(b"other")
    with pytest.raises(BadInput, match="created meanwhile"):
        recorder.close()
    assert (tmp_path / "a.mcap").read_bytes() == b"other"
    assert read_recording(tmp_path / "a.mcap.part").messages == ()


def test_bad_places_and_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="does not exist; create it"):
        Recorder(tmp_path / "missing" / "a.mcap", {}, ()).open()
    with pytest.raises(BadInput, match="is a folder"):
        Recorder(tmp_path, {}, ()).open()
    with pytest.raises(BadInput, match="2 attachments are called 'model'"):
        Recorder(tmp_path / "a.mcap", {}, (Attachment("model", "", b"1"), Attachment("model", "", b"2"))).open()
    with pytest.raises(BadInput, match="surrogates not allowed"):
        Recorder(tmp_path / "a.mcap", {"names": {"path": "\ud800"}}, ()).open()
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_folder_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(BadInput, match=r"cannot be written \(Permission denied\)"):
        Recorder(tmp_path / "a.mcap", {}, ()).open()


class SmallDisk(io.FileIO):
    """A new file on a disk with room for `room` bytes."""

    room = 0

    def write(self, data: Any, /) -> int:
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


@pytest.fixture
def small_disk(monkeypatch: pytest.MonkeyPatch) -> type[SmallDisk]:
    monkeypatch.setattr(Path, "open", lambda path, mode, buffering=-1: io.BufferedWriter(SmallDisk(path, mode)))
    monkeypatch.setattr(SmallDisk, "room", 0)
    return SmallDisk


def test_a_full_disk_at_the_start_leaves_nothing(tmp_path: Path, small_disk: type[SmallDisk]) -> None:
    with pytest.raises(BadInput, match="No space left on device"):
        Recorder(tmp_path / "a.mcap", {}, ()).open()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_on_the_way_keeps_the_part(tmp_path: Path, small_disk: type[SmallDisk]) -> None:
    small_disk.room = 100_000
    noise = np.random.default_rng(1).integers(0, 256, (1200, 1600, 3), np.uint8)
    recorder = Recorder(tmp_path / "a.mcap", {}, ())
    recorder.open()
    with pytest.raises(BadInput, match="No space left on device"):
        recorder.hear(3, m.Frame(3, 3, noise, None))
    recorder.hear(4, m.DeadlinePassed(4))
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.part"]


def test_a_full_disk_at_the_end_keeps_the_part(tmp_path: Path, small_disk: type[SmallDisk]) -> None:
    small_disk.room = 300
    recorder = Recorder(tmp_path / "a.mcap", {}, ())
    recorder.open()
    recorder.hear(1, m.DeadlinePassed(1))
    with pytest.raises(BadInput, match="No space left on device"):
        recorder.close()
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.part"]


# Damage


def test_every_changed_byte_is_noticed(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    data = path.read_bytes()
    with path.open("r+b", buffering=0) as file:
        for position in [*range(0, len(data), 4), *range(len(data) - 60, len(data))]:
            byte = data[position]
            change = 0xFF if position % 9 == 8 else 1 << position % 9
            os.pwrite(file.fileno(), bytes([byte ^ change]), position)
            with pytest.raises(BadRecording, match=r"a\.mcap: "):
                read_recording(path)
            os.pwrite(file.fileno(), bytes([byte]), position)
    assert content(read_recording(path)) == told(HEARD)


def test_every_truncation_and_extension_is_noticed(tmp_path: Path) -> None:
    data = record(tmp_path / "a.mcap").read_bytes()
    damaged = tmp_path / "damaged.mcap"
    ends = {*range(12), *range(len(data) - 50, len(data)), *np.linspace(0, len(data) - 1, 150).astype(int).tolist()}
    for end in sorted(ends):
        damaged.write_bytes(data[:end])
        with pytest.raises(BadRecording, match=r"damaged\.mcap: "):
            read_recording(damaged)
    for tail in (b"\0", data[-8:], data):
        damaged.write_bytes(data + tail)
        with pytest.raises(BadRecording):
            read_recording(damaged)


def test_damage_is_located(tmp_path: Path) -> None:
    data = record(tmp_path / "a.mcap").read_bytes()
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[0]
    attachment = summary.attachment_indexes[0]
    places = {
        chunk.chunk_start_offset + chunk.chunk_length - 5: f"its chunk at byte {chunk.chunk_start_offset} ",
        attachment.offset + attachment.length - 20: f"its attachment at byte {attachment.offset} ",
        12: "its header at byte 8 does not match",
        len(data) - 60: "its summary and footer",
        3: "does not start as an MCAP file",
        len(data) - 3: "does not end as an MCAP file",
    }
    for position, says in places.items():
        changed = bytearray(data)
        changed[position] ^= 0x10
        (tmp_path / "damaged.mcap").write_bytes(changed)
        with pytest.raises(BadRecording, match=says):
            read_recording(tmp_path / "damaged.mcap")


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match=r"none\.mcap: no such file"):
        read_recording(tmp_path / "none.mcap")
    with pytest.raises(BadRecording, match="cannot be read"):
        read_recording(tmp_path)
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(BadRecording, match=r"empty\.mcap: is empty"):
        read_recording(tmp_path / "empty.mcap")
    (tmp_path / "text.mcap").write_text("not a recording at all, " * 10)
    with pytest.raises(BadRecording, match="does not start as an MCAP file"):
        read_recording(tmp_path / "text.mcap")


def foreign(path: Path, write: Callable[[Writer], None], *, data_crcs: bool = True) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, enable_data_crcs=data_crcs)
        writer.start()
        write(writer)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def one_message(topic: str, schema: str | None, data: bytes) -> Callable[[Writer], None]:
    def write(writer: Writer) -> None:
        schema_id = 0 if schema is None else writer.register_schema(schema, "protobuf", b"schema")
        writer.add_message(writer.register_channel(topic, "protobuf", schema_id), 5, data, 5)

    return write


MASK_IMAGE = codec.serialise(codec.encode_frame(m.Frame(0, 0, IMAGE, MASK))[0][1])


@pytest.mark.parametrize(
    ("topic", "schema", "data", "says"),
    [
        ("event", None, b"", "topic 'event' has no schema"),
        ("event", "viewsep.Command", b"", "topic 'event' holds viewsep.Command"),
        ("event", "viewsep.Event", pb.Event().SerializeToString(), r"message 0 \(topic event, 5 ns\): .*unknown kind"),
        ("event", "viewsep.Event", b"\x7a\x00", "a kind or field this version lacks"),
        ("event", "viewsep.Event", b"\x0a\xff", "message 0"),
        ("command", "viewsep.Command", pb.Command(move_to=pb.MoveTo()).SerializeToString(), "view_direction has 0"),
        ("camera/mask", "foxglove.CompressedImage", MASK_IMAGE, "mask of frame 0 is not followed by its picture"),
    ],
)
def test_sound_files_with_strange_content_are_refused(
    tmp_path: Path, topic: str, schema: str | None, data: bytes, says: str
) -> None:
    path = foreign(tmp_path / "strange.mcap", one_message(topic, schema, data))
    with pytest.raises(BadRecording, match=says) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_topics_of_others_are_left_out(tmp_path: Path) -> None:
    path = foreign(tmp_path / "more.mcap", one_message("weather", "viewsep.Event", b"sunny"))
    assert read_recording(path).messages == ()


def test_a_newer_layout_is_refused(tmp_path: Path) -> None:
    path = foreign(tmp_path / "new.mcap", lambda writer: writer.add_metadata("session", {"version": "99"}))
    with pytest.raises(BadRecording, match="is of layout 99, this viewsep reads up to 2: update viewsep"):
        read_recording(path)


def rewritten(path: Path, order: Callable[[Any], Any]) -> bytes:
    """A recording as another tool writes it: in other chunks, in another order, without a CRC over the whole."""
    source = make_reader(io.BytesIO(path.read_bytes()))
    written = io.BytesIO()
    writer = Writer(written, chunk_size=300, compression=CompressionType.NONE, enable_data_crcs=False)
    writer.start()
    channels: dict[int, int] = {}
    for schema, channel, message in sorted(source.iter_messages(log_time_order=False), key=order):
        if channel.id not in channels:
            assert schema is not None
            schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
        row = (message.log_time, message.data, message.publish_time, message.sequence)
        writer.add_message(channels[channel.id], *row)
    for record in source.iter_metadata():
        writer.add_metadata(record.name, record.metadata)
    writer.finish()  # type: ignore[no-untyped-call]
    return written.getvalue()


def test_a_file_rewritten_by_another_tool_keeps_its_order(tmp_path: Path) -> None:
    data = rewritten(record(tmp_path / "a.mcap"), lambda row: (row[2].log_time, row[1].topic != "camera/mask"))
    (tmp_path / "b.mcap").write_bytes(data)
    assert content(read_recording(tmp_path / "b.mcap")) == told(HEARD)
    changed = bytearray(data)
    changed[data.index(b"budget spent")] ^= 1
    (tmp_path / "b.mcap").write_bytes(changed)
    with pytest.raises(BadRecording, match="its chunk at byte"):
        read_recording(tmp_path / "b.mcap")


def test_missing_messages_leave_a_gap(tmp_path: Path) -> None:
    def write(writer: Writer) -> None:
        schema_id = writer.register_schema("viewsep.Event", "protobuf", b"")
        channel = writer.register_channel("event", "protobuf", schema_id)
        for number in (3, 4, 7):
            writer.add_message(channel, number, codec.to_bytes(m.DeadlinePassed(number)), number, number)
        writer.add_metadata("session", {"version": "2"})

    recording = read_recording(foreign(tmp_path / "gaps.mcap", write))
    assert [recorded.stamp_ns for recorded in recording.messages] == [3, 4, 7]
    assert recording.gaps == {0, 2}
    assert read_recording(record(tmp_path / "a.mcap")).gaps == set()


def test_a_mask_needs_its_own_picture(tmp_path: Path) -> None:
    def write(writer: Writer) -> None:
        one_message("camera/mask", "foxglove.CompressedImage", MASK_IMAGE)(writer)
        one_message("event", "viewsep.Event", codec.to_bytes(m.DeadlinePassed(0)))(writer)

    with pytest.raises(BadRecording, match="mask of frame 0 is not followed"):
        read_recording(foreign(tmp_path / "strange.mcap", write))
