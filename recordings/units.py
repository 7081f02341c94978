"""The unit of every number in a recording: metadata of its channel, for people and for tools that plot.

Keys are the paths of fields as a viewer writes them, without indices; `data.NAME` are the packed values of a point
cloud. Units are `ns`, `s`, `rad`, `rad^2` and `byte`, and `1` for everything without one: counts, ratios, components of
unit vectors and quaternions, lengths in radii of the view sphere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

Units: TypeAlias = Mapping[str, str]


def _plain(*names: str) -> Units:
    return dict.fromkeys(names, "1")


def _within(field: str, units: Units) -> Units:
    return {f"{field}.{name}": unit for name, unit in units.items()}


_STAMP: Units = {"stamp_ns": "ns"}
_TIMESTAMP: Units = {"timestamp.seconds": "s", "timestamp.nanos": "ns"}
_VECTOR = _plain("x", "y", "z")
_QUATERNION = _plain("x", "y", "z", "w")
_POSE: Units = {**_within("position", _VECTOR), **_within("orientation", _QUATERNION)}
_CLOUD: Units = {
    **_TIMESTAMP,
    **_within("pose", _POSE),
    **_within("data", {**_VECTOR, **_plain("red", "green", "blue", "alpha")}),
    "point_stride": "byte",
    "fields.offset": "byte",
}

UNITS: Mapping[str, Units] = {
    "camera/image": _TIMESTAMP,
    "camera/mask": _TIMESTAMP,
    "motion/state": {**_STAMP, "position_rad": "rad", "setpoint_rad": "rad"},
    "percept": {**_STAMP, **_plain("sequence", "feature", "view_direction")},
    "event": {
        **_within("task_started", {**_STAMP, **_plain("seed", "view_direction")}),
        **_within("move_settled", {**_STAMP, **_plain("command_id")}),
        **_within("move_failed", {**_STAMP, **_plain("command_id")}),
        **_within("frame_missing", _STAMP),
        **_within("deadline_passed", _STAMP),
        **_within("cancel_requested", _STAMP),
        **_within("rig_failed", _STAMP),
    },
    "command": {
        **_within("move_to", _plain("command_id", "view_direction")),
        **_within("stop", _plain("command_id")),
    },
    "estimate": {
        **_STAMP,
        **_plain("iteration", "comparisons", "target", "unknown"),
        "travel_rad": "rad",
        **_within("candidates", _plain("rating", "w0", "w2", "rotation", "hypotheses", "probability")),
        **_within("candidates", {"w1": "rad", "variance": "rad^2"}),
    },
    "result": {
        **_STAMP,
        **_plain("ratings.rating", "rotation", "looks", "comparisons", "telling_view"),
        **{"travel_rad": "rad", "pose_spread_rad": "rad"},
    },
    "engine/state": _STAMP,
    "tf": {**_TIMESTAMP, **_within("translation", _VECTOR), **_within("rotation", _QUATERNION)},
    "pose": {**_TIMESTAMP, **_within("pose", _POSE)},
    "sphere/views": {**_CLOUD, **_plain("data.node")},
    "sphere/path": {**_CLOUD, **_plain("data.look")},
    "sphere/hypotheses": {**_CLOUD, **_plain("data.weight", "data.candidate")},
    "log": {**_TIMESTAMP, **_plain("line")},
}
"""For each topic the unit of each field."""
