"""Readers that are not ours read everything in a recording, and show of it what the documentation says."""

from __future__ import annotations

import base64
import json
import math
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message as Protobuf

from viewsep.config import parse_config
from viewsep.learning import learn_objects
from viewsep.messages import Frame, HypothesisViews, Message
from viewsep.recordings.codec import encode, encode_frame
from viewsep.recordings.recovery import recover
from viewsep.recordings.scene import Scene
from viewsep.recordings.units import UNITS
from viewsep.task import Task, run_task

pytestmark = [pytest.mark.readers, pytest.mark.needs_pybullet]

NODE = Path(__file__).parent / "node"
SOURCES = ("generated:5", "generated:5:twin=face")
INT64 = (FieldDescriptor.CPPTYPE_INT64, FieldDescriptor.CPPTYPE_UINT64)

# what Rerun makes of each topic: parts of its own archetypes, or a message it takes apart field by field
PICTURE = {"EncodedImage:blob", "EncodedImage:media_type", "CoordinateFrame:frame"}
POSES = {"InstancePoses3D:translations", "InstancePoses3D:quaternions", "CoordinateFrame:frame"}
CLOUD = POSES | {"Points3D:positions", "Points3D:colors"}
FRAMES = {"parent_frame", "child_frame", "translation", "quaternion"}
IN_RERUN = {
    "camera/image": PICTURE,
    "camera/mask": PICTURE,
    "tf": {f"Transform3D:{part}" for part in FRAMES},
    "pose": POSES,
    "sphere/views": CLOUD,
    "sphere/path": CLOUD,
    "sphere/hypotheses": CLOUD,
    "log": {"TextLog:text", "TextLog:level"},
    "motion/state": {"viewsep.JointState:message"},
    "percept": {"viewsep.Percept:message"},
    "event": {"viewsep.Event:message"},
    "command": {"viewsep.Command:message"},
    "estimate": {"viewsep.Estimate:message"},
    "result": {"viewsep.Result:message"},
    "engine/state": {"viewsep.Keyframe:message"},
}


@dataclass
class Heard:
    """The listener that remembers."""

    messages: list[tuple[int, Message]] = field(default_factory=list)

    def hear(self, stamp_ns: int, message: Message) -> None:
        self.messages.append((stamp_ns, message))


@dataclass(frozen=True)
class Made:
    """A recording, and what must be in it: for each topic log times and messages in the order of time."""

    path: Path
    expected: Mapping[str, list[tuple[int, Protobuf]]]

    def of(self, topic: str) -> list[Any]:
        """In the order of time: an estimate is written after read-backs that are later than it."""
        return [message for _, message in sorted(self.expected[topic], key=lambda row: row[0])]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Made]:
    """The recording of one task, and the same cut off in its summary and recovered."""
    path = tmp_path_factory.mktemp("recordings") / "task.mcap"
    config = parse_config({"camera": {"size_px": 64}, "task": {"max_looks": 40}}, "test")
    models = list(learn_objects(SOURCES, ("tea", "decaf"), 48, config))
    heard = Heard()
    run_task(Task(SOURCES[0], "tea", 3, path), config, models, [heard])
    expected = defaultdict(list)
    scene = Scene(config, models)
    for stamp_ns, message in heard.messages:
        for topic, protobuf in written(stamp_ns, message, scene):
            expected[topic].append((stamp_ns, protobuf))
    for rows in expected.values():
        rows.sort(key=lambda row: row[0])  # what was heard a little late is read in its place
    cut = path.with_name("cut.mcap.part")
    cut.write_bytes(path.read_bytes()[:-500])
    recovered = recover(cut)
    assert recovered is not None
    return {"task": Made(path, expected), "recovered": Made(recovered.path, expected)}


def written(stamp_ns: int, message: Message, scene: Scene) -> list[tuple[str, Protobuf]]:
    """What stands in a recording for a message: topics and protobuf messages in order."""
    if isinstance(message, Frame):
        return list(encode_frame(message))
    ours = [] if isinstance(message, HypothesisViews) else [encode(message)]
    return [*ours, *scene.show(stamp_ns, message)]


@pytest.fixture(scope="module", params=["task", "recovered"])
def made(request: pytest.FixtureRequest, both: Mapping[str, Made]) -> Made:
    return both[request.param]


@pytest.fixture(scope="module")
def in_node(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], subprocess.CompletedProcess[str]]:
    """Runs the reader for JavaScript on a file; it is installed into a folder that is thrown away."""
    for program in ("node", "npm"):
        if shutil.which(program) is None:
            pytest.skip(f"NOT CHECKED with @mcap/core: {program} is not installed (apt-get install nodejs npm)")
    folder = tmp_path_factory.mktemp("node")
    for file in NODE.iterdir():
        shutil.copy(file, folder)
    install = ["npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", "--no-package-lock"]
    installed = subprocess.run(install, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    if installed.returncode != 0:
        pytest.skip(f"NOT CHECKED with @mcap/core: npm could not install it: {installed.stderr.strip()[-500:]}")
    return lambda path: subprocess.run(
        ["node", "read.mjs", str(path)], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )


def plain(message: Any) -> dict[str, Any]:
    """A protobuf message as protobufjs writes it to JSON."""
    return {
        field.name: [_plain(field, item) for item in getattr(message, field.name)]
        if field.is_repeated
        else _plain(field, getattr(message, field.name))
        if field.message_type is None or message.HasField(field.name)
        else None
        for field in message.DESCRIPTOR.fields
        if field.containing_oneof is None or message.HasField(field.name)
    }


def _plain(field: FieldDescriptor, value: Any) -> Any:
    if field.message_type is not None:
        return plain(value)
    if field.enum_type is not None:
        return field.enum_type.values_by_number[value].name
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return str(value) if field.cpp_type in INT64 else value


def test_javascript_reads_every_message(made: Made, in_node: Callable[[Path], Any]) -> None:
    ran = in_node(made.path)
    assert ran.returncode == 0, ran.stderr
    read = json.loads(ran.stdout)
    assert read["profile"] == "viewsep"
    assert read["counted"] == sum(len(topic["messages"]) for topic in read["topics"].values())
    assert set(made.expected) <= set(read["topics"])
    for topic, expected in made.expected.items():
        found = read["topics"][topic]
        assert found["schema"] == expected[0][1].DESCRIPTOR.full_name
        assert found["messages"] == [[str(stamp_ns), plain(message)] for stamp_ns, message in expected], topic
        assert found["metadata"] == UNITS[topic], topic


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_javascript_refuses_a_changed_byte(
    share: float, both: Mapping[str, Made], in_node: Callable[[Path], Any], tmp_path: Path
) -> None:
    data = bytearray(both["task"].path.read_bytes())
    data[int(share * len(data))] ^= 1
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    ran = in_node(damaged)
    assert ran.returncode == 1
    assert "CRC" in ran.stderr


@pytest.fixture(scope="module")
def in_rerun(made: Made) -> Mapping[str, Mapping[str, list[Any]]]:
    """What Rerun's own reader makes of the recording, in the order of time.

    For each topic its components, a value for each message.
    """
    from rerun.chunk import McapReader

    found: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    times: dict[str, list[int]] = defaultdict(list)
    for chunk in McapReader(made.path, timeline_type="duration").stream():
        if chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        topic = str(chunk.entity_path).removeprefix("/")
        times[topic] += batch.column("message_log_time").cast("int64").to_pylist()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if ":" in name:
                found[topic][name] += column.to_pylist()
    order = {topic: np.argsort(stamps, kind="stable") for topic, stamps in times.items()}
    return {
        topic: {name: [values[k] for k in order[topic]] for name, values in components.items() if len(values)}
        for topic, components in found.items()
    }


def test_rerun_knows_every_topic(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    assert {topic: set(in_rerun[topic]) for topic in made.expected} == {
        topic: IN_RERUN[topic] for topic in made.expected
    }
    for topic, expected in made.expected.items():
        for component, values in in_rerun[topic].items():
            assert len(values) == len(expected), component


def test_rerun_has_the_pictures(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    for topic, kind in (("camera/image", "image/jpeg"), ("camera/mask", "image/png")):
        pictures: list[CompressedImage] = made.of(topic)
        found = in_rerun[topic]
        assert [bytes(blob) for (blob,) in found["EncodedImage:blob"]] == [picture.data for picture in pictures]
        assert {media for (media,) in found["EncodedImage:media_type"]} == {kind}


def test_rerun_has_the_transforms(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    steps: list[FrameTransform] = made.of("tf")
    found = in_rerun["tf"]
    for part in ("parent", "child"):
        names = [name for (name,) in found[f"Transform3D:{part}_frame"]]
        assert names == [getattr(step, f"{part}_frame_id") for step in steps]
    quaternions = [[step.rotation.x, step.rotation.y, step.rotation.z, step.rotation.w] for step in steps]
    np.testing.assert_allclose(np.array(found["Transform3D:quaternion"])[:, 0], quaternions, atol=1e-6)
    assert found["Transform3D:parent_frame"][0] == ["tf#/"], "nothing ties the scene to the root of Rerun's 3D view"


def test_rerun_has_the_points(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    for topic in ("sphere/views", "sphere/path", "sphere/hypotheses"):
        clouds: list[PointCloud] = made.of(topic)
        found = in_rerun[topic]
        for cloud, positions, colours in zip(
            clouds, found["Points3D:positions"], found["Points3D:colors"], strict=True
        ):
            packed = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
            place, colour = np.ascontiguousarray(packed[:, :12]).view("<f4"), packed[:, 12:16]
            np.testing.assert_array_equal(np.array(positions).reshape(-1, 3), place)
            # a colour is one number there, red first
            np.testing.assert_array_equal(np.array(colours, np.uint32), np.ascontiguousarray(colour).view(">u4")[:, 0])
        assert {frame for (frame,) in found["CoordinateFrame:frame"]} == {"control"}


def test_rerun_has_the_log(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    lines: list[Log] = made.of("log")
    assert [text for (text,) in in_rerun["log"]["TextLog:text"]] == [line.message for line in lines]
    assert len(lines) > 2


def test_rerun_takes_our_own_messages_apart(made: Made, in_rerun: Mapping[str, Mapping[str, list[Any]]]) -> None:
    states = [state for (state,) in in_rerun["motion/state"]["viewsep.JointState:message"]]
    assert [state["position_rad"] for state in states] == [
        list(state.position_rad) for state in made.of("motion/state")
    ]
    (result,) = in_rerun["result"]["viewsep.Result:message"][0]
    assert result["outcome"] == made.of("result")[0].outcome
