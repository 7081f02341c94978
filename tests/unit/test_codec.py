"""What goes through the codec comes back exactly."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from viewsep import messages as m
from viewsep.errors import BadInput, BadRecording
from viewsep.recordings import codec, schemas
from viewsep.recordings.schemas import viewsep_pb2 as pb

INT64 = st.integers(-(2**63), 2**63 - 1)
FLOAT = st.floats() | st.sampled_from([-0.0, 5e-324, float("inf"), -float("inf"), float("nan")])
TEXT = st.text()
PHASE = st.sampled_from(m.Phase)


def doubles(*shape: int) -> st.SearchStrategy[Any]:
    return hnp.arrays(np.float64, shape, elements=FLOAT)


PERCEPT = st.builds(
    m.Percept,
    INT64,
    INT64,
    TEXT,
    hnp.arrays(np.float32, st.integers(0, 20), elements=st.floats(width=32)),
    doubles(3),
    st.lists(TEXT, max_size=3).map(tuple),
    TEXT,
)
OPTIONAL = st.none() | FLOAT
CANDIDATE = st.builds(
    *(m.CandidateEstimate, TEXT, FLOAT, FLOAT, FLOAT, FLOAT, doubles(3, 3), FLOAT, st.booleans(), INT64, OPTIONAL)
)
JOINTS = st.lists(FLOAT).map(tuple)
STRATEGIES: dict[type, st.SearchStrategy[Any]] = {
    m.JointState: st.builds(m.JointState, INT64, JOINTS, JOINTS, st.booleans(), TEXT),
    m.TaskStarted: st.builds(m.TaskStarted, INT64, INT64, doubles(3)),
    m.PerceptReceived: st.builds(m.PerceptReceived, PERCEPT),
    m.MoveSettled: st.builds(m.MoveSettled, INT64, INT64),
    m.MoveFailed: st.builds(m.MoveFailed, INT64, INT64, TEXT),
    m.FrameMissing: st.builds(m.FrameMissing, INT64, TEXT),
    m.DeadlinePassed: st.builds(m.DeadlinePassed, INT64),
    m.CancelRequested: st.builds(m.CancelRequested, INT64, TEXT),
    m.RigFailed: st.builds(m.RigFailed, INT64, TEXT),
    m.MoveTo: st.builds(m.MoveTo, INT64, doubles(3), PHASE),
    m.Stop: st.builds(m.Stop, INT64, TEXT),
    m.Estimate: st.builds(
        m.Estimate,
        INT64,
        INT64,
        PHASE,
        st.lists(CANDIDATE, max_size=3).map(tuple),
        INT64,
        FLOAT,
        st.none() | doubles(3),
        OPTIONAL,
        TEXT,
    ),
    m.Result: st.builds(
        m.Result,
        INT64,
        st.sampled_from(m.Outcome),
        TEXT,
        TEXT,
        st.lists(st.tuples(TEXT, FLOAT)).map(tuple),
        doubles(3, 3),
        INT64,
        FLOAT,
        INT64,
        st.lists(TEXT, max_size=3).map(tuple),
        st.none() | doubles(3),
        OPTIONAL,
    ),
    m.Keyframe: st.builds(m.Keyframe, INT64, st.binary(max_size=100)),
}
MESSAGE = st.one_of(*STRATEGIES.values())


def bits(value: Any) -> Any:
    """`value` so that == compares every type, shape and bit (NaNs as one)."""
    if isinstance(value, np.ndarray):
        canonical = np.where(np.isnan(value), value.dtype.type(np.nan), value)
        return (value.shape, value.dtype, canonical.tobytes())
    if isinstance(value, float):
        return "nan" if value != value else value.hex()
    if isinstance(value, tuple):
        return tuple(bits(item) for item in value)
    if is_dataclass(value):
        return (type(value), *(bits(getattr(value, field.name)) for field in fields(value)))
    return (type(value), value)


def test_every_message_but_the_frame_is_covered() -> None:
    assert set(STRATEGIES) == set(get_args(m.Message)) - {m.Frame, m.HypothesisViews}


@given(MESSAGE)
def test_round_trip_is_exact(message: codec.Recordable) -> None:
    topic, protobuf = codec.encode(message)
    recorded = type(protobuf).FromString(codec.serialise(protobuf))
    decoded = codec.decode(topic, recorded)
    assert bits(decoded) == bits(message)
    assert codec.to_bytes(decoded) == codec.to_bytes(message) == codec.serialise(protobuf)


@pytest.mark.parametrize("value", [-0.0, 0.0, 5e-324, 1e308, float("inf"), -float("inf"), float("nan")])
def test_special_numbers_survive_in_single_fields(value: float) -> None:
    estimate = m.Estimate(0, 0, m.Phase.EXPLORING, (), 0, value, np.full(3, value))
    topic, protobuf = codec.encode(estimate)
    decoded = codec.decode(topic, type(protobuf).FromString(codec.serialise(protobuf)))
    assert bits(decoded) == bits(estimate)


def test_no_target_differs_from_the_null_vector() -> None:
    without = m.Estimate(0, 0, m.Phase.EXPLORING, (), 0, 0.0, None)
    null = m.Estimate(0, 0, m.Phase.EXPLORING, (), 0, 0.0, np.zeros(3))
    assert codec.to_bytes(without) != codec.to_bytes(null)


def test_not_known_differs_from_zero() -> None:
    """A field that is not known is absent, and absent in recordings from before there was such a field."""
    unrated = m.CandidateEstimate("tea", 1.0, 0.5, 0.1, 0.5, np.eye(3), 0.0, True, 50)
    estimate = m.Estimate(0, 0, m.Phase.EXPLORING, (unrated,), 0, 0.0, None)
    result = m.Result(9, m.Outcome.IDENTIFIED, "tea", "why", (), np.eye(3), 3, 0.1, 9)
    for without, with_zero in (
        (estimate, replace(estimate, unknown=0.0)),
        (estimate, replace(estimate, candidates=(replace(unrated, probability=0.0),))),
        (result, replace(result, pose_spread_rad=0.0)),
        (result, replace(result, telling_view=np.zeros(3))),
    ):
        assert codec.to_bytes(without) != codec.to_bytes(with_zero)
    _, older = codec.encode(result)
    assert {"indistinct", "telling_view", "pose_spread_rad"} & {field.name for field, _ in older.ListFields()} == set()


def test_a_note_is_kept_and_without_one_an_estimate_is_what_it_was_before_there_were_notes() -> None:
    plain = m.Estimate(0, 0, m.Phase.EXPLORING, (), 0, 0.0, None)
    noted = replace(plain, note="the object has slipped")
    topic, protobuf = codec.encode(noted)
    assert bits(codec.decode(topic, protobuf)) == bits(noted)
    _, older = codec.encode(plain)
    assert "note" not in {field.name for field, _ in older.ListFields()}
    decoded = codec.decode(topic, older)
    assert isinstance(decoded, m.Estimate)
    assert decoded.note == ""


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (m.MoveTo(1, np.zeros(2), m.Phase.STARTING), r"MoveTo .*view_direction is \(2,\)"),
        (m.MoveTo(1, np.zeros(3, np.float32), m.Phase.STARTING), "float32 instead of"),
        (m.Estimate(0, 0, m.Phase.IDLE, (), 0, 0.0, np.zeros(0)), r"target is \(0,\)"),
        (m.PerceptReceived(m.Percept(0, 0, "cch", np.zeros(4), np.zeros(3))), r"feature is \(4,\) float64"),
        (
            m.Result(9, m.Outcome.UNKNOWN, "", "", (), np.eye(3), 3, 0.1, 9, telling_view=np.zeros(2)),
            r"Result .*telling_view is \(2,\)",
        ),
        (m.TaskStarted(0, 2**63, np.zeros(3)), "TaskStarted cannot be recorded"),
        (m.Stop(1, "\ud800"), "Stop cannot be recorded"),
    ],
)
def test_what_cannot_be_held_exactly_is_refused(message: codec.Recordable, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        codec.encode(message)


@pytest.mark.parametrize(
    ("topic", "protobuf", "says"),
    [
        ("event", pb.Event(), "event of an unknown kind"),
        ("command", pb.Command(), "command of an unknown kind"),
        ("command", pb.Command(move_to=pb.MoveTo(view_direction=[0, 0, 1], purpose="flying")), "'flying'"),
        ("estimate", pb.Estimate(phase="idle", target=[1.0]), "target has 1 numbers"),
        ("result", pb.Result(outcome="identified"), "rotation has 0 numbers"),
        ("result", pb.Result(outcome="unknown", rotation=[0.0] * 9, telling_view=[1.0]), "telling_view has 1 numbers"),
        ("result", pb.Result(outcome="of_the_future", rotation=[0.0] * 9), "'of_the_future'"),
        ("result", pb.Event(), "'result' does not hold viewsep.Event"),
        ("weather", pb.Event(), "'weather'"),
        ("camera/image", pb.Event(), "'camera/image'"),
    ],
)
def test_what_makes_no_sense_is_not_decoded(topic: str, protobuf: Any, says: str) -> None:
    with pytest.raises(BadRecording, match=says):
        codec.decode(topic, protobuf)


def test_a_frame_keeps_its_mask_exactly_and_its_picture_closely() -> None:
    ramp = np.linspace(0, 255, 40 * 60 * 3).reshape(40, 60, 3).astype(np.uint8)
    mask = np.indices((40, 60)).sum(axis=0) % 3 == 0
    (mask_topic, png), (image_topic, jpeg) = codec.encode_frame(m.Frame(5_000_000_007, 9, ramp, mask))
    assert (mask_topic, image_topic) == ("camera/mask", "camera/image")
    assert (png.format, jpeg.format) == ("png", "jpeg")
    assert (jpeg.timestamp.seconds, jpeg.timestamp.nanos) == (5, 7)
    frame = codec.decode_frame(9, jpeg, png).decode()
    assert (frame.stamp_ns, frame.sequence) == (5_000_000_007, 9)
    assert frame.mask is not None
    assert frame.mask.dtype == np.bool_
    assert (frame.mask == mask).all()
    assert frame.image.dtype == np.uint8
    assert np.abs(frame.image.astype(int) - ramp).max() < 8


def test_a_frame_is_recorded_as_rgb() -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 250
    ((_, jpeg),) = codec.encode_frame(m.Frame(0, 0, red, None))
    frame = codec.decode_frame(0, jpeg, None).decode()
    assert frame.mask is None
    assert frame.image[..., 0].min() > 240
    assert frame.image[..., 2].max() < 10


@pytest.mark.parametrize(
    ("image", "mask"),
    [
        (np.zeros((4, 4), np.uint8), None),
        (np.zeros((4, 4, 3)), None),
        (np.zeros((0, 4, 3), np.uint8), None),
        (np.zeros((4, 4, 3), np.uint8), np.zeros((4, 5), np.bool_)),
        (np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint8)),
    ],
)
def test_bad_frames_are_refused(image: m.Array, mask: m.Array | None) -> None:
    with pytest.raises(BadInput, match="frame 7: its"):
        codec.encode_frame(m.Frame(0, 7, image, mask))


def test_damaged_pictures_are_reported() -> None:
    ((_, mask), (_, jpeg)) = codec.encode_frame(m.Frame(0, 7, np.zeros((4, 4, 3), np.uint8), np.ones((4, 4), np.bool_)))
    with pytest.raises(BadRecording, match="neither JPEG nor PNG"):
        codec.RecordedFrame(0, 7, b"", None).decode()
    with pytest.raises(BadRecording, match="neither JPEG nor PNG"):
        codec.RecordedFrame(0, 7, jpeg.data, b"nonsense").decode()
    ((_, larger),) = codec.encode_frame(m.Frame(0, 7, np.zeros((8, 8, 3), np.uint8), None))
    with pytest.raises(BadRecording, match="frame 7: its mask"):
        codec.RecordedFrame(0, 7, larger.data, mask.data).decode()


def without_version(path: Path) -> list[str]:
    """The generated lines but for the protobuf version in the header."""
    lines = path.read_text().splitlines()
    start = next((i for i, line in enumerate(lines) if line.startswith("DESCRIPTOR")), 0)
    return lines[start:]


def test_generated_modules_match_the_schema(tmp_path: Path) -> None:
    folder = Path(schemas.__file__).parent
    command = ["-m", "grpc_tools.protoc", f"-I{folder}", f"--python_out={tmp_path}", f"--pyi_out={tmp_path}"]
    subprocess.run([sys.executable, *command, str(folder / "viewsep.proto")], check=True)
    for name in ("viewsep_pb2.py", "viewsep_pb2.pyi"):
        assert without_version(tmp_path / name) == without_version(folder / name), "run `make schemas`"
