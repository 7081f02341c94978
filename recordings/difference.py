"""Where two protobuf messages differ, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message as Protobuf


class Words(str):
    """What is said of a field in place of its value: how many there are, or whether it is there."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """A field that differs: the fields around it from the outside in, its name, and both values.

    Of lists of different lengths the values are `Words` that say how many there are; where a field is present in one
    message only, they are the words "present" and "absent".
    """

    around: tuple[str, ...]
    name: str
    values: tuple[Any, Any]

    @property
    def path(self) -> str:
        """The whole way to the field, such as `candidates[1].rotation[5]`."""
        return ".".join((*self.around, self.name))


def first_difference(recorded: Protobuf, again: Protobuf, tolerance: float) -> str:
    """Name and both values of the first field that differs, empty when none does; `differences` has the rules."""
    found = next(differences(recorded, again, tolerance), None)
    if found is None:
        return ""
    around = "".join(f"in {name!r}, " for name in found.around)
    a, b = (value if isinstance(value, Words) else repr(value) for value in found.values)
    return f"{around}field {found.name!r}: {a} recorded, {b} now"


def differences(a: Protobuf, b: Protobuf, tolerance: float) -> Iterator[FieldDifference]:
    """Every field that differs, in the schema's order.

    Floats may differ by `tolerance` relative to the larger of them and 1; everything else must be equal.
    """
    return _within((), a, b, tolerance)


def _within(around: tuple[str, ...], a: Protobuf, b: Protobuf, tolerance: float) -> Iterator[FieldDifference]:
    for field in a.DESCRIPTOR.fields:
        x, y = getattr(a, field.name), getattr(b, field.name)
        pairs = [(x, y)]
        if field.is_repeated:
            if len(x) != len(y):
                yield FieldDifference(around, field.name, (Words(f"{len(x)} values"), Words(f"{len(y)} values")))
                continue
            pairs = list(zip(x, y, strict=True))
        elif field.has_presence and a.HasField(field.name) != b.HasField(field.name):
            there, not_there = Words("present"), Words("absent")
            values = (there, not_there) if a.HasField(field.name) else (not_there, there)
            yield FieldDifference(around, field.name, values)
            continue
        for index, (p, q) in enumerate(pairs):
            name = f"{field.name}[{index}]" if field.is_repeated else field.name
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                yield from _within((*around, name), p, q, tolerance)
            elif not _same(p, q, tolerance):
                yield FieldDifference(around, name, (p, q))


def _same(a: object, b: object, tolerance: float) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        exact = a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
        return exact or (tolerance > 0 and (a == b or abs(a - b) <= tolerance * max(1.0, abs(a), abs(b))))
    return a == b
