"""`viewsep recordings diff`: the first difference by topic, number, time, field and values, and how much differs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_recording import GOLDEN, golden, where, with_message, with_metadata, without_message, write
from shell import Shell

from viewsep import messages as m
from viewsep.errors import BadInput
from viewsep.recordings import codec
from viewsep.recordings.compare import COMPARABLE, ENGINE, Comparison, compare
from viewsep.recordings.reader import Recorded, Recording

Change = Callable[[Recording], Recording]


def engine_before(index: int) -> int:
    """How many of the engine's messages stand before a message."""
    return sum(recorded.topic in ENGINE for recorded in golden().messages[:index])


def estimate_11() -> int:
    return where(golden(), "estimate")[11]


def altered(kind: str, number: int, change: Callable[[Any], m.Message]) -> Change:
    return lambda recording: with_message(recording, where(recording, kind)[number], change)


def less(kind: str, number: int) -> Change:
    return lambda recording: without_message(recording, where(recording, kind)[number])


def turned(estimate: m.Estimate, by: float = 1e-9) -> m.Estimate:
    first, second = estimate.candidates
    rotation = second.rotation.copy()
    rotation[1, 2] += by
    return replace(estimate, candidates=(first, replace(second, rotation=rotation)))


def heard_later(recording: Recording) -> Recording:
    index = where(recording, "command")[3]
    late = replace(recording.messages[index], stamp_ns=recording.messages[index].stamp_ns + 5)
    return replace(recording, messages=(*recording.messages[:index], late, *recording.messages[index + 1 :]))


def with_keyframe(state: bytes) -> Change:
    def change(recording: Recording) -> Recording:
        message = m.Keyframe(7, state)
        return replace(
            recording,
            messages=(*recording.messages, Recorded("engine/state", 7, message, codec.to_bytes(message))),
        )

    return change


def other_picture(recording: Recording) -> Recording:
    frames = list(recording.frames)
    frames[4] = replace(frames[4], jpeg=frames[4].jpeg[:100] + frames[5].jpeg[100:])
    return replace(recording, frames=tuple(frames))


def other_mask(recording: Recording) -> Recording:
    frames = list(recording.frames)
    frames[4] = replace(frames[4], mask_png=None)
    return replace(recording, frames=tuple(frames))


def less_picture(recording: Recording) -> Recording:
    return replace(recording, frames=recording.frames[:4] + recording.frames[5:])


def other_model(recording: Recording) -> Recording:
    return with_metadata(recording, "models", product_7="0" * 64)


def other_config(recording: Recording) -> Recording:
    config = json.loads(recording.metadata["config"]["json"])
    config["task"]["max_looks"] = 25
    return with_metadata(recording, "config", json=json.dumps(config))


def other_attachment(recording: Recording) -> Recording:
    return replace(recording, attachments={**recording.attachments, "product_7.viewsep": b"PK"})


FOUND: dict[str, tuple[Change, str]] = {
    "estimate": (
        altered("estimate", 11, turned),
        r"estimate 11 at \d+\.\d{3} s, field candidates\[1\]\.rotation\[5\]: (-?\d\.\d+) in A, (-?\d\.\d+) in B",
    ),
    "event of another kind": (
        altered("event", 3, lambda event: m.DeadlinePassed(event.stamp_ns)),
        r"event 3 at 9.700 s, kind: move_settled in A, deadline_passed in B",
    ),
    "percept's feature": (
        altered("percept", 5, lambda e: m.PerceptReceived(replace(e.percept, feature=e.percept.feature[:-1]))),
        r"percept 5 at \d+\.\d{3} s, field feature: 320 values in A, 319 values in B",
    ),
    "result": (
        altered("result", 0, lambda result: replace(result, reason="x" * 200)),
        r"result 0 at 17.600 s, field reason: 'its path rates .* separating view' in A, 'x{79}\.\.\. in B",
    ),
    "probability": (
        altered(
            "estimate",
            11,
            lambda e: replace(e, candidates=(replace(e.candidates[0], probability=0.0), e.candidates[1])),
        ),
        r"estimate 11 at \d+\.\d{3} s, field candidates\[0\]\.probability: absent in A, present in B",
    ),
    "none of them": (
        altered("estimate", 11, lambda estimate: replace(estimate, unknown=0.0)),
        r"estimate 11 at \d+\.\d{3} s, field unknown: absent in A, present in B",
    ),
    "indistinguishable": (
        altered("result", 0, lambda result: replace(result, indistinct=("tea", "decaf"))),
        r"result 0 at 17.600 s, field indistinct: 0 values in A, 2 values in B",
    ),
    "message missing": (less("estimate", 11), r"A has estimate 11 at \d+\.\d{3} s where B has "),
    "result missing": (less("result", 0), r"^result 0 at 17.600 s is in A only$"),
    "heard later": (heard_later, r"command 3 at \d\.\d{3} s, heard at: \d+ in A, \d+ in B"),
    "read-back": (
        altered("motion/state", 70, lambda state: replace(state, moving=not state.moving)),
        r"motion/state 70 at \d\.\d{3} s, field moving: (True|False) in A, (True|False) in B",
    ),
    "picture": (
        other_picture,
        r"camera/image 40 at 1.333 s, picture: 7,125 bytes in A, 6,427 in B, the same up to byte \d+",
    ),
    "no mask": (other_mask, r"^camera/mask 40 at 1.333 s is in A only$"),
    "picture missing": (less_picture, r"^camera/image 40 at 1.333 s is in A only$"),
    "model": (other_model, r"model product_7: 'd89b1ce\w+' in A, '0{64}' in B"),
    "attachment": (other_attachment, r"attachment product_7.viewsep: 159,309 bytes in A, 2 in B, the same up to byte"),
    "configuration": (other_config, r"key task.max_looks: 400 in A, 25 in B"),
    "task": (lambda recording: with_metadata(recording, "task", seed="2"), r"seed: '1' in A, '2' in B"),
}


@pytest.mark.parametrize(("change", "words"), FOUND.values(), ids=FOUND.keys())
def test_the_first_difference_is_told(change: Change, words: str) -> None:
    found = compare(golden(), change(golden()))
    assert found.first is not None
    assert re.search(words, found.first.text), found.first.text


def test_the_parts_of_a_difference() -> None:
    a, b = golden(), altered("estimate", 11, turned)(golden())
    found = compare(a, b)
    index = estimate_11()
    was, now = a.messages[index].message, b.messages[index].message
    assert isinstance(was, m.Estimate)
    assert isinstance(now, m.Estimate)
    assert found.first is not None
    assert (found.first.topic, found.first.number, found.first.stamp_ns) == ("estimate", 11, was.stamp_ns)
    assert found.first.field == "field candidates[1].rotation[5]"
    assert (found.first.a, found.first.b) == (was.candidates[1].rotation[1, 2], now.candidates[1].rotation[1, 2])


def test_what_is_equal_before_is_counted() -> None:
    found = compare(golden(), altered("estimate", 11, turned)(golden()))
    of = sum(recorded.topic in ENGINE for recorded in golden().messages)
    assert (found.equal_before, found.of) == (engine_before(estimate_11()), (of, of))
    before = [recorded for recorded in golden().messages[: estimate_11()] if recorded.topic in ENGINE]
    assert found.equal_until_ns == before[-1].stamp_ns


def test_nothing_is_equal_before_the_first_message() -> None:
    found = compare(golden(), altered("event", 0, lambda event: replace(event, seed=9))(golden()))
    assert (found.equal_before, found.equal_until_ns) == (0, None)
    assert found.first is not None
    assert found.first.field == "field task_started.seed"


def test_messages_that_differ_are_counted_by_topic() -> None:
    changed = golden()
    for number in (3, 11, 20):
        changed = altered("estimate", number, turned)(changed)
    changed = less_picture(less("motion/state", 1100)(other_mask(changed)))
    counted = compare(golden(), changed).topics
    assert {topic: count.differing for topic, count in counted.items() if count.differing} == {
        "estimate": 3,
        "motion/state": 1,
        "camera/image": 1,
        "camera/mask": 1,
    }
    assert (counted["motion/state"].a, counted["motion/state"].b) == (1101, 1100)


def test_the_engine_comes_first_then_read_backs_then_pictures_then_the_rest() -> None:
    changes = [
        altered("result", 0, lambda result: replace(result, looks=1)),
        altered("motion/state", 0, lambda state: replace(state, fault="hot")),
        other_picture,
        other_model,
        other_config,
    ]
    expected = ["result", "motion/state", "camera/image", "models", "config"]
    changed = golden()
    for change in changes:
        changed = change(changed)
    for topic in expected:
        found = compare(golden(), changed, only=COMPARABLE[COMPARABLE.index(topic) :])
        assert found.first is not None
        assert found.first.topic == topic


def test_states_of_the_engine_are_compared() -> None:
    a, b = with_keyframe(b"x" * 50)(golden()), with_keyframe(b"x" * 40 + b"y")(golden())
    first = compare(a, b).first
    assert first is not None
    assert first.text == "engine/state 0 at 0.000 s, field state: 50 bytes in A, 41 in B, the same up to byte 40"
    assert (first.a, first.b) == ("50 bytes", "41 bytes")
    assert compare(a, with_keyframe(b"x" * 50)(golden())).first is None


def same(found: Comparison) -> bool:
    return found.first is None and not any(counted.differing for counted in found.topics.values())


def test_a_recording_is_the_same_as_itself() -> None:
    found = compare(golden(), golden())
    assert same(found)
    assert (found.about, found.notes) == ((), ())
    assert found.topics["estimate"].a == found.topics["estimate"].b == 33


def test_floats_may_differ_within_the_tolerance() -> None:
    changed = altered("estimate", 11, turned)(golden())
    assert same(compare(golden(), changed, 1e-8))
    assert not same(compare(golden(), changed, 1e-10))
    assert not same(compare(golden(), changed))
    assert not same(compare(golden(), heard_later(golden()), 1.0))


def test_a_negative_zero_is_another_number_unless_tolerated() -> None:
    a = altered("motion/state", 5, lambda state: replace(state, position_rad=(0.0, 1.0)))(golden())
    b = altered("motion/state", 5, lambda state: replace(state, position_rad=(-0.0, 1.0)))(golden())
    first = compare(a, b).first
    assert first is not None
    assert first.text.endswith("field position_rad[0]: 0.0 in A, -0.0 in B")
    assert same(compare(a, b, 1e-12))


def test_the_wall_clock_is_no_difference_and_the_build_a_note() -> None:
    other = with_metadata(golden(), "session", anchor_unix_ns="5", opened_unix_ns="4")
    assert compare(golden(), other).notes == ()
    other = with_metadata(with_metadata(other, "build", numpy="3.0"), "recovered", lost="1")
    found = compare(golden(), other)
    assert same(found)
    assert found.notes == (
        "made by another build: numpy: '2.4.6' in A, '3.0' in B",
        "the metadata record 'recovered' differs",
    )


def test_a_key_that_is_left_out_counts_as_its_default() -> None:
    config = json.loads(golden().metadata["config"]["json"])
    full = with_metadata(golden(), "config", json=json.dumps(config | {"recording": {"keyframe_s": 5.0}}))
    found = compare(golden(), full)
    assert same(found)
    assert found.notes == ("one configuration leaves out keys of recording: they count as the defaults",)
    other = with_metadata(golden(), "config", json=json.dumps(config | {"recording": {"keyframe_s": 1.0}}))
    first = compare(golden(), other).first
    assert first is not None
    assert first.text == "key recording.keyframe_s: 5.0 in A, 1.0 in B"


def test_configurations_of_other_versions_are_compared_as_they_stand() -> None:
    newer = with_metadata(golden(), "config", json='{"unheard_of": [1, {"b": 2}]}')
    texts = {difference.text for difference in compare(golden(), newer).about}
    assert "key unheard_of[1].b: absent in A, 2 in B" in texts
    assert "key rig.backend: 'sim' in A, absent in B" in texts
    broken = compare(golden(), with_metadata(golden(), "config", json="{"))
    assert [difference.field for difference in broken.about] == ["key json"]


def test_only_what_is_named_is_compared() -> None:
    changed = other_config(altered("estimate", 11, turned)(golden()))
    assert same(compare(golden(), changed, only=("event", "percept", "models")))
    found = compare(golden(), changed, only=("config", "estimate"))
    assert list(found.topics) == ["estimate"]
    assert (found.equal_before, found.of) == (11, (33, 33))
    with pytest.raises(BadInput, match=r"'estimates' cannot be compared: choose of event, percept, command, "):
        compare(golden(), changed, only=("estimates",))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """The golden recording without pictures, the same once more, and one with a changed estimate and configuration."""
    folder = tmp_path_factory.mktemp("files")
    changed = other_config(altered("estimate", 11, turned)(golden()))
    return (
        write(golden(), folder / "a.mcap", {}),
        write(golden(), folder / "again.mcap", {}),
        write(changed, folder / "changed.mcap", {}),
    )


def test_the_command_tells_that_two_are_the_same(files: tuple[Path, Path, Path], shell: Shell) -> None:
    ended = shell("recordings", "diff", files[0], files[1])
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines() == ["the same, byte for byte: 1,240 messages and pictures"]
    ended = shell("recordings", "diff", files[0], files[2], "--tolerance", "1e-6", "--only", "estimate, result")
    assert ended.code == 0
    assert ended.out.splitlines() == ["what was chosen is the same, with floats within 1e-06: 34 messages and pictures"]


def test_the_command_tells_what_differs(files: tuple[Path, Path, Path], shell: Shell) -> None:
    ended = shell("recordings", "diff", files[0], files[2])
    assert ended.code == 1
    lines = ended.out.splitlines()
    assert lines[0] == "different (byte for byte); the first difference:"
    assert lines[1].startswith("  estimate 11 at ")
    assert lines[2].startswith(
        f"equal before it: {engine_before(estimate_11())} of 139 messages in A, 139 in B (the engine's), up to "
    )
    assert any(line.split() == ["│", "estimate", "│", "33", "│", "33", "│", "1", "│"] for line in lines)
    assert lines[-1] == "config: key task.max_looks: 400 in A, 25 in B"


def test_the_command_tells_that_only_the_configuration_differs(
    files: tuple[Path, Path, Path], tmp_path: Path, shell: Shell
) -> None:
    changed = write(other_config(golden()), tmp_path / "b.mcap", {})
    ended = shell("recordings", "diff", files[0], changed)
    assert ended.code == 1
    assert ended.out.splitlines() == [
        "different (byte for byte); the first difference:",
        "  config: key task.max_looks: 400 in A, 25 in B",
    ]
    assert shell("recordings", "diff", files[0], changed, "--json").json["sequence"] is None


def test_the_command_tells_it_as_json(files: tuple[Path, Path, Path], shell: Shell) -> None:
    said = shell("recordings", "diff", files[0], files[2], "--json").json
    assert (said["same"], said["tolerance"]) == (False, 0.0)
    first = said["first"]
    assert (first["topic"], first["number"], first["field"]) == ("estimate", 11, "field candidates[1].rotation[5]")
    assert first["time_s"] == first["stamp_ns"] / 1e9
    assert np.isclose(first["b"] - first["a"], 1e-9)
    assert said["topics"]["estimate"] == {"a": 33, "b": 33, "differing": 1}
    assert [difference["text"] for difference in said["about"]] == ["key task.max_looks: 400 in A, 25 in B"]
    ended = shell("recordings", "diff", files[0], files[1], "--json")
    assert (ended.code, ended.json["same"], ended.json["first"]) == (0, True, None)


BAD = {
    "tolerance below 0": (("--tolerance", "-1"), "--tolerance -1: give a number from 0 on"),
    "no tolerance": (("--tolerance", "nan"), "--tolerance nan: give a number from 0 on"),
    "unknown topic": (("--only", "estimate,tf"), "--only: 'tf' cannot be compared: choose of event,"),
    "empty topic": (("--only", ""), "--only: '' cannot be compared"),
}


@pytest.mark.parametrize(("typed", "words"), BAD.values(), ids=BAD.keys())
def test_options_that_make_no_sense_are_refused(typed: tuple[str, ...], words: str, shell: Shell) -> None:
    ended = shell("recordings", "diff", GOLDEN, GOLDEN, *typed)
    assert (ended.code, ended.out) == (2, "")
    assert words in ended.err


def test_files_that_cannot_be_read_are_refused(tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "diff", GOLDEN, tmp_path / "b.mcap")
    assert (ended.code, ended.out) == (2, "")
    assert "b.mcap: no such file" in ended.err
    (tmp_path / "b.mcap").write_bytes(GOLDEN.read_bytes()[:-100])
    ended = shell("recordings", "diff", tmp_path / "b.mcap", GOLDEN)
    assert (ended.code, ended.out) == (2, "")
    assert "truncated" in ended.err
