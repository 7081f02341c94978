"""Where two recordings differ: the first difference in words, and how much differs in all."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from google.protobuf.message import Message as Protobuf

from viewsep.config import parse_config
from viewsep.errors import BadConfig, BadInput
from viewsep.recordings.codec import IMAGE_TOPIC, MASK_TOPIC, SCHEMAS
from viewsep.recordings.difference import Words, differences
from viewsep.recordings.reader import Recording
from viewsep.recordings.writer import SESSION

ENGINE = ("event", "percept", "command", "estimate", "result")
PICTURES = (IMAGE_TOPIC, MASK_TOPIC)
AFTERWARDS = tuple(topic for topic in SCHEMAS if topic not in (*ENGINE, *PICTURES))
ABOUT = ("models", "config", "task")
COMPARABLE = (*ENGINE, *AFTERWARDS, *PICTURES, *ABOUT)
"""What can be compared, in the order the first difference is looked for. The engine's messages are one sequence."""

_SHOWN = 80  # characters of a value
_PRESENT, _ABSENT = Words("present"), Words("absent")


@dataclass(frozen=True, slots=True)
class Item:
    """One recorded message or picture, heard at `stamp_ns`; `raw` is all of it.

    `number` counts a topic's messages from 0; of pictures and masks it is the frame's sequence number.
    """

    topic: str
    number: int
    stamp_ns: int
    raw: bytes

    def told(self, start_ns: int) -> str:
        """Which one it is, with its time since `start_ns`."""
        return f"{self.topic} {self.number} at {(self.stamp_ns - start_ns) / 1e9:.3f} s"


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference: what differs and how, in words, and the same in parts for programs.

    `number` and `stamp_ns` are of A's message, or of B's where A has none; None for what is no message.
    """

    topic: str
    number: int | None
    stamp_ns: int | None
    field: str
    a: Any
    b: Any
    text: str


@dataclass(frozen=True, slots=True)
class Counted:
    """How many messages a topic has in A and in B, and how many of them differ."""

    a: int
    b: int
    differing: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """What was found. `first` is None where nothing differs.

    In the first difference's `sequence` (the engine's messages are one; empty where it is in no message) `equal_before`
    messages, of so many in A and B as `of` says, are the same before it, the last of them at `equal_until_ns`. `about`
    are all differences of models, configuration and task. `notes` tell what is not a difference.
    """

    first: Difference | None
    sequence: str
    equal_before: int
    of: tuple[int, int]
    equal_until_ns: int | None
    topics: dict[str, Counted]
    about: tuple[Difference, ...]
    notes: tuple[str, ...]


def compare(a: Recording, b: Recording, tolerance: float = 0.0, only: Collection[str] = ()) -> Comparison:
    """Compare everything, or what is named in `only` (of COMPARABLE), floats within `tolerance` as `differences` says.

    The wall clock always differs and is not compared. Raises BadInput for a name that is not COMPARABLE.
    """
    for name in only:
        if name not in COMPARABLE:
            raise BadInput(f"{name!r} cannot be compared: choose of {', '.join(COMPARABLE)}")
    wanted = only or COMPARABLE
    items_a, items_b = _items(a), _items(b)
    start_ns = min((item.stamp_ns for item in items_a), default=0)
    first, sequence, equal_before, of, until_ns = None, "", 0, (0, 0), None
    for name, topics in (
        ("the engine's", ENGINE),
        *((topic, (topic,)) for topic in AFTERWARDS),
        ("pictures", PICTURES),
    ):
        chosen = [topic for topic in topics if topic in wanted]
        mine, others = ([item for item in items if item.topic in chosen] for items in (items_a, items_b))
        found = _first(mine, others, tolerance, start_ns)
        if found is not None:
            (equal_before, first), sequence = found, name
            of = len(mine), len(others)
            until_ns = max((item.stamp_ns for item in mine[:equal_before]), default=None)
            break
    about, notes = _about(a, b)
    about = tuple(difference for difference in about if difference.topic in wanted)
    if first is None and about:
        first = about[0]
    counted = {
        topic: _count(items_a, items_b, topic, tolerance)
        for topic in COMPARABLE
        if topic in SCHEMAS and topic in wanted
    }
    return Comparison(first, sequence, equal_before, of, until_ns, counted, about, notes)


def _items(recording: Recording) -> list[Item]:
    """Messages in the order they were heard, then pictures, each before its mask."""
    counted: Counter[str] = Counter()
    items = []
    for recorded in recording.messages:
        items.append(Item(recorded.topic, counted[recorded.topic], recorded.stamp_ns, recorded.raw))
        counted[recorded.topic] += 1
    for frame in recording.frames:
        items.append(Item(IMAGE_TOPIC, frame.sequence, frame.stamp_ns, frame.jpeg))
        if frame.mask_png is not None:
            items.append(Item(MASK_TOPIC, frame.sequence, frame.stamp_ns, frame.mask_png))
    return items


def _first(a: Sequence[Item], b: Sequence[Item], tolerance: float, start_ns: int) -> tuple[int, Difference] | None:
    """How many are the same before the first difference, and that one; None where all are the same."""
    for index, (x, y) in enumerate(_pairs(a, b)):
        difference = _differ(x, y, tolerance, start_ns) if x and y else _alone(x, y, start_ns)
        if difference is not None:
            return index, difference
    return None


def _pairs(a: Sequence[Item], b: Sequence[Item]) -> Iterator[tuple[Item | None, Item | None]]:
    """Messages in the same place of their sequence, pictures and masks with the same number."""
    if not all(item.topic in PICTURES for item in (*a, *b)):
        yield from zip_longest(a, b)
        return
    mine, others = ({(item.number, item.topic): item for item in items} for items in (a, b))
    for key in sorted(mine.keys() | others.keys()):
        yield mine.get(key), others.get(key)


def _alone(a: Item | None, b: Item | None, start_ns: int) -> Difference | None:
    """The difference where one of the two is missing."""
    item = a or b
    if item is None:
        return None
    values = (_PRESENT, _ABSENT) if a else (_ABSENT, _PRESENT)
    text = f"{item.told(start_ns)} is in {'A' if a else 'B'} only"
    return Difference(item.topic, item.number, item.stamp_ns, "", *values, text)


def _differ(a: Item, b: Item, tolerance: float, start_ns: int) -> Difference | None:
    """The difference of two messages in the same place, None where there is none."""
    if a.topic != b.topic:
        text = f"A has {a.told(start_ns)} where B has {b.told(start_ns)}"
        return Difference(a.topic, a.number, a.stamp_ns, "topic", a.topic, b.topic, text)
    if a == b:
        return None
    found = next(_fields(a, b, tolerance), None)
    if found is None:
        return None
    field, x, y = found
    text = f"{a.told(start_ns)}, {field}: {_shown(x)} in A, {_shown(y)} in B"
    if isinstance(x, bytes) and isinstance(y, bytes):
        text = f"{a.told(start_ns)}, {field}: {_bytes_differ(x, y)}"
        x, y = f"{len(x)} bytes", f"{len(y)} bytes"
    return Difference(a.topic, a.number, a.stamp_ns, field, x, y, text)


def _fields(a: Item, b: Item, tolerance: float) -> Iterator[tuple[str, Any, Any]]:
    """What differs in two messages of one topic: name and both values."""
    if a.topic in PICTURES:
        if a.raw != b.raw:
            yield "picture" if a.topic == IMAGE_TOPIC else "mask", a.raw, b.raw
    elif a.raw != b.raw:
        x, y = SCHEMAS[a.topic].FromString(a.raw), SCHEMAS[b.topic].FromString(b.raw)
        kinds = _kind(x), _kind(y)
        if kinds[0] != kinds[1]:
            yield "kind", Words(kinds[0]), Words(kinds[1])
        some = False
        for difference in differences(x, y, tolerance):
            some = True
            yield f"field {difference.path}", *difference.values
        if not some and tolerance == 0:
            yield "serialised", a.raw, b.raw
    if a.stamp_ns != b.stamp_ns:
        yield "heard at", a.stamp_ns, b.stamp_ns


def _kind(protobuf: Protobuf) -> str:
    """Which of several kinds of message it is, empty where there is one kind only."""
    choices = [choice for choice in protobuf.DESCRIPTOR.oneofs if len(choice.fields) > 1]  # of one: an optional field
    return ".".join(protobuf.WhichOneof(choice.name) or "" for choice in choices)


def _count(a: Sequence[Item], b: Sequence[Item], topic: str, tolerance: float) -> Counted:
    mine, others = ({item.number: item for item in items if item.topic == topic} for items in (a, b))
    both = mine.keys() & others.keys()
    differing = sum(_differ(mine[number], others[number], tolerance, 0) is not None for number in both)
    return Counted(len(mine), len(others), differing + len(mine.keys() ^ others.keys()))


def _about(a: Recording, b: Recording) -> tuple[tuple[Difference, ...], tuple[str, ...]]:
    """Differences of models, configuration and task, and notes on what may differ."""
    (config_a, config_b), notes = _configs(a, b)
    found = [
        *_keys("models", "model", a.metadata.get("models", {}), b.metadata.get("models", {})),
        *_keys("models", "attachment", a.attachments, b.attachments),
        *_keys("config", "key", config_a, config_b),
        *_keys("task", "", a.metadata.get("task", {}), b.metadata.get("task", {})),
    ]
    notes += [f"made by another build: {d.text}" for d in _keys("", "", *(r.metadata.get("build", {}) for r in (a, b)))]
    for name in sorted({*a.metadata, *b.metadata} - {"build", SESSION, *ABOUT}):
        if a.metadata.get(name) != b.metadata.get(name):
            notes.append(f"the metadata record {name!r} differs")
    return tuple(found), tuple(notes)


def _configs(a: Recording, b: Recording) -> tuple[tuple[dict[str, Any], dict[str, Any]], list[str]]:
    """Both configurations as flat keys, what is left out with its default; as they stand where that cannot be told."""
    texts = [recording.metadata.get("config", {}).get("json", "{}") for recording in (a, b)]
    try:
        given = [json.loads(text) for text in texts]
    except ValueError:
        return ({"json": texts[0]}, {"json": texts[1]}), []
    raw = _flat(given[0]), _flat(given[1])
    try:
        full = [_flat(parse_config(table, "").model_dump(mode="json")) for table in given]
    except BadConfig:
        return raw, []
    lacking = {key.split(".")[0] for key in set(raw[0]) ^ set(raw[1])}
    notes = [f"one configuration leaves out keys of {', '.join(sorted(lacking))}: they count as the defaults"]
    return (full[0], full[1]), notes if lacking else []


def _flat(table: Any, prefix: str = "") -> dict[str, Any]:
    """Nested tables and lists as one, with keys such as `rig.joints[0].axis[2]`; an empty one has a key of its own."""
    if isinstance(table, Mapping) and table:
        rows = [_flat(value, f"{prefix}.{key}" if prefix else str(key)) for key, value in table.items()]
    elif isinstance(table, list) and table:
        rows = [_flat(value, f"{prefix}[{index}]") for index, value in enumerate(table)]
    else:
        return {prefix: table}
    return {key: value for row in rows for key, value in row.items()}


def _keys(topic: str, what: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Difference]:
    """Differences of two tables, key by key in order."""
    for key in sorted({*a, *b}):
        x, y = a.get(key, _ABSENT), b.get(key, _ABSENT)
        if x == y:
            continue
        name = f"{what} {key}".strip()
        if isinstance(x, bytes) and isinstance(y, bytes):
            text = f"{name}: {_bytes_differ(x, y)}"
        else:
            text = f"{name}: {_shown(x)} in A, {_shown(y)} in B"
        yield Difference(topic, None, None, name, _plain(x), _plain(y), text)


def _plain(value: Any) -> Any:
    return f"{len(value)} bytes" if isinstance(value, bytes) else value


def _shown(value: Any) -> str:
    """A value in a sentence, cut where it is long."""
    if isinstance(value, bytes):
        return str(_plain(value))
    text = str(value) if isinstance(value, Words) else repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _bytes_differ(a: bytes, b: bytes) -> str:
    same = next((index for index, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    return f"{len(a):,} bytes in A, {len(b):,} in B, the same up to byte {same:,}"
