"""The layout and the units speak of topics and fields that there are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest
from google.protobuf.descriptor import FieldDescriptor

from viewsep.recordings.codec import SCHEMAS
from viewsep.recordings.scene import CHANNELS
from viewsep.recordings.units import UNITS

RECORDED: dict[str, Any] = {topic: schema.DESCRIPTOR for topic, schema in {**SCHEMAS, **CHANNELS}.items()}
NUMERIC = {
    FieldDescriptor.CPPTYPE_DOUBLE,
    FieldDescriptor.CPPTYPE_FLOAT,
    FieldDescriptor.CPPTYPE_INT32,
    FieldDescriptor.CPPTYPE_INT64,
    FieldDescriptor.CPPTYPE_UINT32,
    FieldDescriptor.CPPTYPE_UINT64,
}
SHOWN_BY = {
    "sphere/views": "foxglove.PointCloud",
    "sphere/path": "foxglove.PointCloud",
    "sphere/hypotheses": "foxglove.PointCloud",
    "pose": "foxglove.PoseInFrame",
}
STEP = re.compile(r"([a-z_][a-z0-9_]*)(\[\d+\])?")


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    text = (files("viewsep.recordings") / "layouts" / "viewsep.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded


def panels(layout: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    found = [config for name, config in layout["configById"].items() if name.split("!")[0] == kind]
    assert found, f"there is no {kind} panel"
    return found


def leaves(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        yield from leaves(node["first"])
        yield from leaves(node["second"])


def numbers(descriptor: Any) -> Iterator[str]:
    """Paths of all numeric fields of a message, those of the messages within it too."""
    for field in descriptor.fields:
        if field.message_type is not None:
            yield from (f"{field.name}.{name}" for name in numbers(field.message_type))
        elif field.cpp_type in NUMERIC:
            yield field.name


def field_at(path: str) -> Any:
    """The field that a message path such as `estimate.candidates[0].w0` points at."""
    topic, *steps = path.split(".")
    descriptor, field = RECORDED[topic], None
    for step in steps:
        match = STEP.fullmatch(step)
        assert match, f"{path}: {step!r} is no field"
        assert descriptor is not None, f"{path}: {step!r} is within no message"
        field = descriptor.fields_by_name[match[1]]
        assert field.is_repeated == (match[2] is not None), f"{path}: {step!r} is a list, or is none"
        descriptor = field.message_type
    assert field is not None, f"{path}: names no field"
    return field


def test_every_panel_is_placed_once(layout: dict[str, Any]) -> None:
    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


def test_what_is_plotted_is_recorded_and_a_number(layout: dict[str, Any]) -> None:
    paths = [series["value"] for panel in panels(layout, "Plot") for series in panel["paths"]]
    for path in paths:
        assert field_at(path).cpp_type in NUMERIC, path
    plotted = " ".join(paths)
    assert all(name in plotted for name in (".w0", ".w1", ".rating", ".position_rad"))


def test_the_states_are_recorded(layout: dict[str, Any]) -> None:
    paths = [series["value"] for panel in panels(layout, "StateTransitions") for series in panel["paths"]]
    assert "estimate.phase" in paths
    for path in paths:
        field = field_at(path)
        assert field.cpp_type in (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_BOOL), path


def test_picture_log_and_scene_are_recorded_as_their_panels_want_them(layout: dict[str, Any]) -> None:
    (image,), (log,), (scene,) = (panels(layout, kind) for kind in ("Image", "RosOut", "3D"))
    assert RECORDED[image["imageMode"]["imageTopic"]].full_name == "foxglove.CompressedImage"
    assert RECORDED[log["topicToRender"]].full_name == "foxglove.Log"
    assert {topic: RECORDED[topic].full_name for topic in scene["topics"]} == SHOWN_BY
    assert all(settings["visible"] for settings in scene["topics"].values())


def test_the_checks_find_wrong_paths() -> None:
    for path in ("estimate.candidates.w0", "estimate.w0", "estimate.phase[0]", "estimate.phase.w0", "estimate"):
        with pytest.raises((AssertionError, KeyError)):
            field_at(path)
    with pytest.raises(KeyError):
        field_at("nothing.w0")


@pytest.mark.parametrize("topic", RECORDED)
def test_every_number_has_a_unit(topic: str) -> None:
    assert set(numbers(RECORDED[topic])) == {name for name in UNITS[topic] if not name.startswith("data.")}


def test_units_are_given_for_recorded_topics_in_few_words() -> None:
    assert set(UNITS) == set(RECORDED)
    assert {unit for units in UNITS.values() for unit in units.values()} == {"1", "ns", "s", "rad", "rad^2", "byte"}


@pytest.mark.parametrize("topic", RECORDED)
def test_units_agree_with_the_names_of_fields(topic: str) -> None:
    for name, unit in UNITS[topic].items():
        for ending, says in (("_ns", "ns"), ("_rad", "rad")):
            if name.endswith(ending):
                assert unit == says, name
