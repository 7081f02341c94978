"""What viewers are given beside the messages says the same as the messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message as Protobuf
from hypothesis import given
from hypothesis import strategies as st

from viewsep import messages as m
from viewsep.config import Config, geometry_of, parse_config
from viewsep.geometry import axis_rotation, fibonacci_sphere, quaternion_to_matrix
from viewsep.kinematics import PRESETS
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.recordings.codec import decode_frame, encode_frame, serialise
from viewsep.recordings.scene import CHANNELS, FIXED_EVERY_NS, LONGEST_PATH, Scene
from viewsep.recordings.units import UNITS

Shown = Sequence[tuple[str, Protobuf]]

NODES = fibonacci_sphere(12)
TURNED = axis_rotation(np.array([0.0, 0.0, 1.0]), 0.5)
ANGLE = st.floats(-7.0, 7.0)


def model(name: str) -> AspectGraph:
    none = np.empty((0, 2), np.int32)
    features = np.zeros((len(NODES), 4), np.float32)
    return AspectGraph(name, NODES, none, features, none, "cch", {}, Provenance("", "", ""))


def rig(preset: str) -> Config:
    return parse_config({"rig": {"preset": preset}}, "test")


def scene(preset: str = "pan_tilt") -> Scene:
    return Scene(rig(preset), [model("tea"), model("decaf")])


def candidate(name: str, rating: float, rotation: m.FloatArray = TURNED) -> m.CandidateEstimate:
    return m.CandidateEstimate(name, rating, 0.5, 0.1, 0.5, rotation, float("inf"), False, 50)


def estimate(*candidates: m.CandidateEstimate, phase: m.Phase = m.Phase.STARTING) -> m.Estimate:
    return m.Estimate(5, 1, phase, candidates, 0, 0.0, np.array([1.0, 0.0, 0.0]))


def percept(view: m.FloatArray) -> m.PerceptReceived:
    return m.PerceptReceived(m.Percept(5, 1, "cch", np.zeros(4, np.float32), view))


def direction(azimuth_deg: float) -> m.FloatArray:
    return np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0])


def read_back(*position: float) -> m.JointState:
    return m.JointState(0, position, position, False)


def transforms(shown: Shown) -> dict[str, FrameTransform]:
    return {message.child_frame_id: message for _, message in shown if isinstance(message, FrameTransform)}


def one(shown: Shown, topic: str) -> Any:
    (message,) = [message for name, message in shown if name == topic]
    return message


def rotation_of(quaternion: Any) -> m.FloatArray:
    return quaternion_to_matrix(np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w]))


def placed(frames: dict[str, FrameTransform], frame: str) -> tuple[m.FloatArray, m.FloatArray]:
    """Rotation and origin of a frame in `base`, along the chain of its parents."""
    if frame == "base":
        return np.eye(3), np.zeros(3)
    step = frames[frame]
    rotation, origin = placed(frames, step.parent_frame_id)
    offset = np.array([step.translation.x, step.translation.y, step.translation.z])
    return rotation @ rotation_of(step.rotation), origin + rotation @ offset


def unpacked(cloud: PointCloud) -> Any:
    """The points of a cloud as its fields say they are packed."""
    kinds = {7: "<f4", 1: "u1", 5: "<u4"}
    names = [field.name for field in cloud.fields]
    formats, offsets = [kinds[field.type] for field in cloud.fields], [field.offset for field in cloud.fields]
    layout = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": cloud.point_stride})
    return np.frombuffer(cloud.data, layout)


def places(cloud: PointCloud) -> m.FloatArray:
    points = unpacked(cloud)
    return np.stack([points["x"], points["y"], points["z"]], axis=1)


def lines(shown: Shown) -> list[tuple[int, str]]:
    return [(message.level, message.message) for _, message in shown if isinstance(message, Log)]


def said(*messages: m.Message) -> list[tuple[int, str]]:
    told = scene()
    return [line for message in messages for line in lines(told.show(7, message))]


@given(st.sampled_from(sorted(PRESETS)), st.data())
def test_the_joints_carry_control_to_where_the_kinematics_say(preset: str, data: st.DataObject) -> None:
    geometry = geometry_of(rig(preset).rig)
    position = data.draw(st.tuples(*[ANGLE] * len(geometry.axes)))
    frames = transforms(scene(preset).show(3, read_back(*position)))
    control, origin = placed(frames, "control")
    np.testing.assert_allclose(control, geometry.holder_rotation(position), atol=1e-9)
    np.testing.assert_allclose(origin, 0.0)
    camera = placed(frames, "camera")[1]
    seen_from = control.T @ camera
    np.testing.assert_allclose(seen_from / np.linalg.norm(seen_from), geometry.view_direction(position), atol=1e-9)


@pytest.mark.parametrize("elevation_deg", [-90.0, -20.0, 0.0, 25.0, 90.0])
def test_the_camera_looks_at_the_object_and_stands_upright(elevation_deg: float) -> None:
    config = parse_config({"rig": {"preset": "turntable", "camera_elevation_deg": elevation_deg}}, "test")
    frames = transforms(Scene(config, []).show(0, read_back(0.3)))
    axes, origin = placed(frames, "camera")
    right, down, forward = axes.T
    np.testing.assert_allclose(forward, -origin / np.linalg.norm(origin), atol=1e-9)
    np.testing.assert_allclose(np.cross(right, down), forward, atol=1e-9)
    assert abs(right[2]) < 1e-9
    assert down[2] <= 1e-9


def test_each_joint_has_its_frame_under_the_one_before() -> None:
    frames = transforms(scene("wrist").show(0, read_back(0.1, 0.2, 0.3)))
    parents = {child: step.parent_frame_id for child, step in frames.items()}
    assert parents == {
        "base": "tf#/",
        "camera": "base",
        "joint/roll": "base",
        "joint/pitch": "joint/roll",
        "joint/yaw": "joint/pitch",
        "control": "joint/yaw",
    }


def test_joints_of_one_name_are_told_apart() -> None:
    joints = [{"name": "turn", "axis": [0, 1, 0]}, {"name": "turn", "axis": [0, 0, 1]}]
    frames = transforms(Scene(parse_config({"rig": {"joints": joints}}, "test"), []).show(0, read_back(0.1, 0.2)))
    assert {"joint/turn/1", "joint/turn/2"} < set(frames)


def test_what_never_moves_is_told_again_once_a_second() -> None:
    told = scene()
    step = FIXED_EVERY_NS // 4
    fixed = [n for n in range(9) if "camera" in transforms(told.show(n * step, read_back(0.1, 0.2)))]
    assert fixed == [0, 4, 8]


@pytest.mark.parametrize("position", [(), (0.1,), (0.1, 0.2, 0.3), (0.1, np.nan), (np.inf, 0.0)])
def test_joints_that_cannot_be_drawn_are_left_out(position: tuple[float, ...]) -> None:
    assert scene("pan_tilt").show(0, read_back(*position)) == []


def test_every_candidate_has_its_pose_and_the_best_is_the_pose() -> None:
    other = axis_rotation(np.array([1.0, 0.0, 0.0]), -0.7)
    shown = scene().show(5, estimate(candidate("tea", 3.0, other), candidate("decaf", 1.5)))
    frames = transforms(shown)
    assert {step.parent_frame_id for step in frames.values()} == {"control"}
    np.testing.assert_allclose(rotation_of(frames["object/tea"].rotation), other, atol=1e-12)
    np.testing.assert_allclose(rotation_of(frames["object/decaf"].rotation), TURNED, atol=1e-12)
    best = one(shown, "pose")
    assert isinstance(best, PoseInFrame)
    assert best.frame_id == "control"
    np.testing.assert_allclose(rotation_of(best.pose.orientation), TURNED, atol=1e-12)


def test_the_views_are_the_best_models_turned_by_its_pose() -> None:
    cloud = one(scene().show(5, estimate(candidate("tea", 3.0), candidate("decaf", 1.5))), "sphere/views")
    np.testing.assert_allclose(places(cloud), NODES @ TURNED.T, atol=1e-6)
    assert unpacked(cloud)["node"].tolist() == list(range(len(NODES)))


def test_the_views_are_told_when_they_moved_only() -> None:
    told = scene()
    slightly, further = (axis_rotation(np.array([0.0, 0.0, 1.0]), 0.5 + angle) for angle in (1e-4, 1e-2))
    told_of = [
        any(topic == "sphere/views" for topic, _ in told.show(5, estimate(*candidates)))
        for candidates in [
            [candidate("tea", 1.0), candidate("decaf", 2.0)],
            [candidate("tea", 1.0), candidate("decaf", 2.0)],
            [candidate("tea", 1.0, slightly), candidate("decaf", 2.0)],
            [candidate("tea", 1.0, further), candidate("decaf", 2.0)],
            [candidate("tea", 2.0, further), candidate("decaf", 1.0, further)],
        ]
    ]
    assert told_of == [True, False, False, True, True]


@pytest.mark.parametrize("rotation", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.diag([1.0, 1.0, -1.0])])
def test_a_pose_that_is_no_rotation_is_left_out(rotation: m.FloatArray) -> None:
    shown = scene().show(5, estimate(candidate("tea", 1.0, rotation), candidate("decaf", 2.0)))
    assert set(transforms(shown)) == {"object/decaf"}
    assert scene().show(5, estimate(candidate("tea", 1.0, rotation))) == []
    assert scene().show(5, estimate()) == []


def test_the_path_grows_with_every_new_view_and_starts_anew_with_a_task() -> None:
    told = scene()
    start = m.TaskStarted(1, 3, direction(0))
    looks = [percept(direction(azimuth)) for azimuth in (0, 10, 20, 20.01)]
    events: list[m.Message] = [start, *looks, start]
    paths = [[message for topic, message in told.show(5, event) if topic == "sphere/path"] for event in events]
    assert [len(unpacked(path[0])) if path else 0 for path in paths] == [1, 0, 2, 3, 0, 1]  # type: ignore[arg-type]
    (longest,) = paths[3]
    assert isinstance(longest, PointCloud)
    assert longest.frame_id == "control"
    np.testing.assert_allclose(places(longest), [direction(0), direction(10), direction(20)], atol=1e-6)
    assert unpacked(longest)["look"].tolist() == [0, 2, 3]
    assert (np.diff(unpacked(longest)["red"].astype(int)) > 0).all()


def test_the_path_keeps_the_newest_views() -> None:
    told = scene()
    views = [direction(azimuth) for azimuth in np.arange(LONGEST_PATH + 20) * 0.5]
    for view in views:
        shown = told.show(5, percept(view))
    cloud = one(shown, "sphere/path")
    np.testing.assert_allclose(places(cloud), views[20:], atol=1e-6)


def test_hypotheses_stand_where_they_believe_the_camera_to_be() -> None:
    owner, weight = np.array([0, 1, 0]), np.array([0.5, 0.3, 0.2])
    seen = m.HypothesisViews(5, ("tea", "decaf"), owner, NODES[:3], weight)
    points = unpacked(one(scene().show(5, seen), "sphere/hypotheses"))
    np.testing.assert_allclose(np.stack([points["x"], points["y"], points["z"]], 1), NODES[:3], atol=1e-6)
    np.testing.assert_allclose(points["weight"], weight, atol=1e-7)
    assert points["candidate"].tolist() == owner.tolist()
    colours = [tuple(point[["red", "green", "blue"]]) for point in points]
    assert colours[0] == colours[2] != colours[1]
    assert points["alpha"][0] == 255 > points["alpha"][1] > points["alpha"][2]


def test_no_hypotheses_are_an_empty_cloud() -> None:
    nothing = m.HypothesisViews(5, ("tea",), np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))
    assert len(unpacked(one(scene().show(5, nothing), "sphere/hypotheses"))) == 0


@pytest.mark.parametrize(
    ("message", "level", "sentence"),
    [
        (m.TaskStarted(1, 3, direction(0)), Log.INFO, "Task started with seed 3; candidates: tea, decaf."),
        (m.MoveFailed(1, 4, "it is jammed"), Log.WARNING, "Move 4 failed: it is jammed"),
        (m.FrameMissing(1, "no frame in 1 s"), Log.WARNING, "No frame: no frame in 1 s"),
        (m.DeadlinePassed(1), Log.WARNING, "The time for this task is up."),
        (m.CancelRequested(1, "Ctrl-C"), Log.WARNING, "Cancelled: Ctrl-C"),
        (m.RigFailed(1, "unplugged"), Log.ERROR, "The rig failed: unplugged"),
        (m.JointState(1, (), (), False, "too hot"), Log.ERROR, "Fault: too hot"),
    ],
)
def test_what_happens_is_said(message: m.Message, level: int, sentence: str) -> None:
    assert said(message) == [(level, sentence)]


@pytest.mark.parametrize(
    ("outcome", "named", "level", "sentence"),
    [
        (m.Outcome.IDENTIFIED, "tea", Log.INFO, "Identified as tea: why"),
        (m.Outcome.IDENTIFIED, "Tea_Earl", Log.INFO, "Identified as Tea_Earl: why"),
        (m.Outcome.UNKNOWN, "", Log.WARNING, "Unknown, none of the candidates: why"),
        (m.Outcome.UNDECIDED, "", Log.WARNING, "Undecided: why"),
        (m.Outcome.FAILED, "", Log.ERROR, "Failed: why"),
    ],
)
def test_the_result_is_said_with_its_reason(outcome: m.Outcome, named: str, level: int, sentence: str) -> None:
    assert said(m.Result(9, outcome, named, "why", (), TURNED, 3, 0.1, 9)) == [(level, sentence)]


def test_what_cannot_be_told_apart_is_said_with_the_view_that_would_help() -> None:
    twins = m.Result(9, m.Outcome.INDISTINGUISHABLE, "", "no view does", (), TURNED, 3, 0.1, 9, ("Tea", "decaf"))
    assert said(twins) == [(Log.WARNING, "Indistinguishable, Tea or decaf: no view does")]
    below = replace(twins, telling_view=np.array([0.0, 0.0, -1.0]))
    ((_, sentence),) = said(below)
    assert sentence.endswith("no view does; azimuth 0°, elevation -90° would, which it cannot reach")


def test_a_change_of_phase_is_said_once() -> None:
    phases = [m.Phase.EXPLORING, m.Phase.EXPLORING, m.Phase.APPROACHING, m.Phase.JUDGING]
    sentences = [text for _, text in said(*(estimate(phase=phase) for phase in phases))]
    assert [text.split(":")[0] for text in sentences] == [
        "Exploring",
        "Driving to the separating view at azimuth 0.0 deg, elevation 0.0 deg.",
        "Judging",
    ]


def test_a_fault_is_said_when_it_comes_and_when_it_goes() -> None:
    hot, well = m.JointState(1, (), (), False, "too hot"), m.JointState(1, (), (), False)
    assert [text for _, text in said(well, hot, hot, well)] == ["Fault: too hot", "The fault is cleared."]


def test_pictures_are_in_the_frame_of_the_camera() -> None:
    pictures = encode_frame(m.Frame(1, 1, np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.bool_)))
    assert [picture.frame_id for _, picture in pictures] == ["camera", "camera"]
    assert "camera" in transforms(scene().show(0, read_back(0.1, 0.2)))


def test_pictures_that_name_no_frame_are_read() -> None:
    frame = m.Frame(7, 3, np.full((2, 2, 3), 90, np.uint8), np.ones((2, 2), np.bool_))
    (_, mask), (_, picture) = encode_frame(frame)
    for image in (mask, picture):
        image.ClearField("frame_id")
    read = decode_frame(3, picture, mask).decode()
    assert (read.stamp_ns, read.sequence) == (7, 3)
    np.testing.assert_array_equal(read.mask, frame.mask)


EVERY_KIND: list[m.Message] = [
    read_back(0.1, 0.2),
    m.TaskStarted(1, 3, direction(0)),
    m.MoveTo(1, direction(5), m.Phase.STARTING),
    m.Stop(2, "arrived"),
    m.MoveSettled(2, 1),
    m.MoveFailed(2, 1, "why"),
    m.FrameMissing(2, "why"),
    m.Frame(3, 1, np.zeros((2, 2, 3), np.uint8), None),
    percept(direction(10)),
    estimate(candidate("tea", 1.0), candidate("decaf", 2.0)),
    m.HypothesisViews(5, ("tea",), np.zeros(2, int), NODES[:2], np.full(2, 0.5)),
    m.Keyframe(5, b"state"),
    m.Result(9, m.Outcome.UNDECIDED, "", "why", (), TURNED, 3, 0.1, 9),
]


def shown(told: Scene, messages: Iterable[m.Message]) -> list[tuple[str, Protobuf]]:
    return [row for stamp_ns, message in enumerate(messages, 1_500_000_000) for row in told.show(stamp_ns, message)]


def test_every_topic_is_declared_with_its_type() -> None:
    rows = shown(scene(), EVERY_KIND)
    assert {topic: type(message) for topic, message in rows} == dict(CHANNELS)


def test_packed_values_have_units() -> None:
    clouds = [(topic, message) for topic, message in shown(scene(), EVERY_KIND) if isinstance(message, PointCloud)]
    assert len({topic for topic, _ in clouds}) == 3
    for topic, cloud in clouds:
        packed = {f"data.{field.name}" for field in cloud.fields}
        assert packed == {name for name in UNITS[topic] if name.startswith("data.")}


def test_every_message_has_the_time_it_was_heard() -> None:
    for stamp_ns, message in enumerate(EVERY_KIND, 1_500_000_000):
        for _, row in scene().show(stamp_ns, message):
            assert row.timestamp.ToNanoseconds() == stamp_ns  # type: ignore[attr-defined]


def test_the_same_messages_make_the_same_scene() -> None:
    once, again = ([(topic, serialise(row)) for topic, row in shown(scene(), EVERY_KIND)] for _ in range(2))
    assert once == again
