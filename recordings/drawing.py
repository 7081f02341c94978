"""Foxglove's messages from arrays: what common viewers show without a plug-in.

Lengths are in radii of the view sphere, colours are sRGB. Frames are named by text; an orientation turns coordinates
of the child frame, or of the object, into those of the frame it is given in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from viewsep.geometry import matrix_to_quaternion
from viewsep.messages import Array, FloatArray

UNTURNED = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)

_NS_PER_S = 1_000_000_000
_PLACE = [(name, "<f4") for name in ("x", "y", "z")] + [(name, "u1") for name in ("red", "green", "blue", "alpha")]
_NUMERIC = {"<f4": PackedElementField.FLOAT32, "|u1": PackedElementField.UINT8, "<u4": PackedElementField.UINT32}


def timestamp(stamp_ns: int) -> Timestamp:
    """Nanoseconds of the session's clock as protobuf has them."""
    return Timestamp(seconds=stamp_ns // _NS_PER_S, nanos=stamp_ns % _NS_PER_S)


def turned(rotation: FloatArray) -> Quaternion:
    """The orientation that a rotation matrix (3, 3) gives."""
    x, y, z, w = (float(part) for part in matrix_to_quaternion(rotation))
    return Quaternion(x=x, y=y, z=z, w=w)


def turned_about(axis: Sequence[float], angle_rad: float) -> Quaternion:
    """The orientation after turning by `angle_rad` about the unit vector `axis` (3,)."""
    x, y, z = axis
    sine = math.sin(angle_rad / 2.0)
    return Quaternion(x=x * sine, y=y * sine, z=z * sine, w=math.cos(angle_rad / 2.0))


def transform(
    stamp_ns: int,
    parent: str,
    child: str,
    orientation: Quaternion = UNTURNED,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> FrameTransform:
    """Where the frame `child` stands in `parent`: its orientation and its origin (3,)."""
    x, y, z = origin
    return FrameTransform(
        timestamp=timestamp(stamp_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=orientation,
    )


def pose(stamp_ns: int, frame: str, orientation: Quaternion) -> PoseInFrame:
    """Something at the origin of `frame`."""
    at_origin = Pose(position=Vector3(), orientation=orientation)
    return PoseInFrame(timestamp=timestamp(stamp_ns), frame_id=frame, pose=at_origin)


def points(
    stamp_ns: int, frame: str, position: FloatArray, colour: Array, fields: Sequence[tuple[str, str, Array]] = ()
) -> PointCloud:
    """Points (N, 3) with colours (N, 4) uint8 red, green, blue, alpha, and further `fields`: name, type `<f4` or `<u4`
    and (N,) values."""
    packed = np.zeros(len(position), np.dtype([*_PLACE, *((name, kind) for name, kind, _ in fields)]))
    columns = [*position.T, *colour.T, *(values for _, _, values in fields)]
    layout: Mapping[str, Any] = packed.dtype.fields or {}
    for name, values in zip(layout, columns, strict=True):
        packed[name] = values
    return PointCloud(
        timestamp=timestamp(stamp_ns),
        frame_id=frame,
        pose=Pose(position=Vector3(), orientation=UNTURNED),
        point_stride=packed.dtype.itemsize,
        fields=[
            PackedElementField(name=name, offset=entry[1], type=_NUMERIC[entry[0].str])
            for name, entry in layout.items()
        ],
        data=packed.tobytes(),
    )


def log(stamp_ns: int, level: Log.Level.ValueType, sentence: str) -> Log:
    """A sentence about what happened."""
    return Log(timestamp=timestamp(stamp_ns), level=level, message=sentence, name="viewsep")
