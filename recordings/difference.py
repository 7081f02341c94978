"""Where two protobuf messages differ, in words."""

from __future__ import annotations

import math

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message as Protobuf


def first_difference(recorded: Protobuf, again: Protobuf, tolerance: float) -> str:
    """Name and both values of the first field that differs, empty when none does.

    Floats may differ by `tolerance` relative to the larger of them and 1; everything else must be equal.
    """
    for field in recorded.DESCRIPTOR.fields:
        a, b = getattr(recorded, field.name), getattr(again, field.name)
        pairs = [(a, b)]
        if field.is_repeated:
            if len(a) != len(b):
                return f"field {field.name!r}: {len(a)} values recorded, {len(b)} now"
            pairs = list(zip(a, b, strict=True))
        elif field.has_presence and recorded.HasField(field.name) != again.HasField(field.name):
            return f"field {field.name!r}: present in one only"
        for index, (x, y) in enumerate(pairs):
            name = f"{field.name}[{index}]" if field.is_repeated else field.name
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                inner = first_difference(x, y, tolerance)
                if inner:
                    return f"in {name!r}, {inner}"
            elif not _same(x, y, tolerance):
                return f"field {name!r}: {x!r} recorded, {y!r} now"
    return ""


def _same(a: object, b: object, tolerance: float) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        exact = a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
        return exact or (tolerance > 0 and (a == b or abs(a - b) <= tolerance * max(1.0, abs(a), abs(b))))
    return a == b
