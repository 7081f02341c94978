"""`viewsep recordings info`: everything that is in a file, how much of it is left when it is damaged, whose it is."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from golden_recording import GOLDEN, TRUTH, golden, where
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from shell import Shell

from viewsep.errors import BadRecording
from viewsep.messages import Outcome, Result
from viewsep.recordings.contents import State, look_into
from viewsep.recordings.jpeg import jpeg_size
from viewsep.recordings.writer import Recorder


@pytest.fixture(scope="module")
def data() -> bytes:
    return GOLDEN.read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording that is quick to read: the first hundred messages."""
    path = tmp_path_factory.mktemp("small") / "a.mcap"
    with Recorder(path, {"task": {"seed": "7"}}) as recorder:
        for recorded in golden().messages[:100]:
            recorder.hear(recorded.stamp_ns, recorded.message)
    return path.read_bytes()


def test_every_topic_is_counted_as_in_the_summary(shell: Shell) -> None:
    (said,) = shell("recordings", "info", GOLDEN, "--json").json
    with GOLDEN.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        sizes: dict[str, int] = {}
        for _, channel, message in make_reader(file).iter_messages():
            sizes[channel.topic] = sizes.get(channel.topic, 0) + len(message.data)
    counts = {
        summary.channels[number].topic: count for number, count in summary.statistics.channel_message_counts.items()
    }
    assert {topic["topic"]: topic["messages"] for topic in said["topics"]} == counts
    assert {topic["topic"]: topic["bytes"] for topic in said["topics"]} == sizes
    span_s = (summary.statistics.message_end_time - summary.statistics.message_start_time) / 1e9
    assert said["duration_s"] == span_s == max(topic["last_s"] for topic in said["topics"])


def test_json_tells_what_was_recorded(shell: Shell) -> None:
    ended = shell("recordings", "info", GOLDEN, "--json")
    (said,) = ended.json
    assert ended.code == 0
    assert (said["state"], said["problem"], said["bytes"]) == ("whole", None, GOLDEN.stat().st_size)
    assert (said["viewsep"], said["build"]["python"]) == ("0.1.0", "3.11.7")
    assert said["began"] == "2026-11-27T06:39:44.965+00:00"
    assert said["rig"] == {"name": "gimbal", "joints": ["tilt", "pan"], "backend": "sim"}
    digests = golden().metadata["models"]
    assert said["candidates"] == [{"name": name, "digest": digests[name]} for name in ("product_7", TRUTH)]
    assert (said["seed"], said["truth"], said["outcome"], said["object"]) == (1, TRUTH, "identified", TRUTH)
    assert said["reason"].startswith("its path rates 6.9 times better")
    assert said["looks"] == 33
    assert said["pictures"] == [{"width_px": 80, "height_px": 80, "pictures": 66}]
    image = next(topic for topic in said["topics"] if topic["topic"] == "camera/image")
    assert said["pictures_hz"] == image["rate_hz"] == pytest.approx(65 / (image["last_s"] - image["first_s"]))
    assert {a["name"]: a["bytes"] for a in said["attachments"]} == {k: len(v) for k, v in golden().attachments.items()}


def test_people_are_told_the_same(shell: Shell) -> None:
    ended = shell("recordings", "info", GOLDEN)
    assert ended.code == 0
    for words in (
        f"{GOLDEN}: whole, 928,517 bytes",
        "viewsep 0.1.0 (python 3.11.7,",
        "2026-11-27 06:39:44.965 UTC, lasted 17.600 s",
        "gimbal (sim), joints tilt, pan",
        "product_7_twin_face f6b3159b7d39",
        "identified as product_7_twin_face: its path rates",
        "66 of 80 x 80 pixels, 3.75 per second",
        "product_7.viewsep, 159,309 bytes",
        "motion/state",
    ):
        assert words in ended.out


@pytest.mark.parametrize("kept", [9, 400, 330_000, 700_000, -1])
def test_a_cut_recording_tells_what_is_left(kept: int, data: bytes, tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(data[:kept])
    ended = shell("recordings", "info", path)
    assert ended.code == 1
    assert "damaged" in ended.out
    assert "truncated" in ended.out
    assert f"viewsep recordings recover {path}" in ended.out
    (said,) = shell("recordings", "info", path, "--json").json
    assert said["state"] == "damaged"
    assert "truncated" in said["problem"]
    assert sum(topic["messages"] for topic in said["topics"]) == (1372 if kept == -1 else 0)  # it has one chunk
    assert (said["seed"] == 1) is (kept not in (9, 400))


def test_an_unfinished_recording_is_called_so(data: bytes, tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "run.mcap.part"
    path.write_bytes(data[:800_000])
    ended = shell("recordings", "info", path)
    assert ended.code == 1
    assert "unfinished" in ended.out
    assert f"it may still be recorded to; if not, `viewsep recordings recover {path}`" in ended.out


def test_a_complete_part_is_to_be_renamed(data: bytes, tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "run.mcap.part"
    path.write_bytes(data)
    ended = shell("recordings", "info", path)
    assert ended.code == 0
    assert "rename it to run.mcap" in ended.out


@pytest.mark.parametrize("at", [500, 400_000, -60])
def test_a_changed_byte_is_damage(at: int, data: bytes, tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    ended = shell("recordings", "info", path, "--json")
    assert ended.code == 1
    assert "CRC" in ended.json[0]["problem"]


@given(at=st.floats(0, 1, exclude_max=True), cut=st.booleans(), bit=st.integers(0, 7))
def test_whatever_is_damaged_is_noticed(
    at: float, cut: bool, bit: int, small: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = int(at * len(small))
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    path.write_bytes(small[:place] if cut else small[:place] + bytes([small[place] ^ 1 << bit]) + small[place + 1 :])
    try:
        contents = look_into(path)
    except BadRecording:
        assert place < 40  # the magic or the header, which says whose it is
    else:
        assert contents.state is State.DAMAGED
        assert contents.problem


def foreign(path: Path, profile: str) -> Path:
    """An MCAP file with a topic of another program."""
    with path.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(profile=profile)
        channel = writer.register_channel("tf", "json", writer.register_schema("Transform", "jsonschema", b"{}"))
        for number in range(3):
            writer.add_message(channel, 10**9 * number, b"{}", 10**9 * number)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_topics_for_other_programs_are_listed(tmp_path: Path, shell: Shell) -> None:
    path = foreign(tmp_path / "a.mcap", "viewsep")
    ended = shell("recordings", "info", path)
    assert ended.code == 0
    assert "tf (for viewers)" in ended.out
    (topic,) = shell("recordings", "info", path, "--json").json[0]["topics"]
    assert topic == {
        "topic": "tf",
        "schema": "Transform",
        "messages": 3,
        "first_s": 0.0,
        "last_s": 2.0,
        "rate_hz": 1.0,
        "bytes": 6,
        "read_by_viewsep": False,
    }


def test_a_recording_of_nothing_is_told(tmp_path: Path, shell: Shell) -> None:
    with Recorder(tmp_path / "a.mcap", {}):
        pass
    ended = shell("recordings", "info", tmp_path / "a.mcap")
    assert ended.code == 0
    assert "none recorded" in ended.out


def make(tmp_path: Path, what: str) -> Path:
    path = tmp_path / "a.mcap"
    match what:
        case "folder":
            path.mkdir()
        case "empty":
            path.touch()
        case "text":
            path.write_text("not a recording\n")
        case "foreign":
            foreign(path, "ros2")
    return path


BAD = {
    "missing": "no such file; check the name",
    "folder": "cannot be read (Is a directory); give a recording's file",
    "empty": "is empty; record again",
    "text": "is not an MCAP file (it begins with 6e6f742061207265)",
    "foreign": "is an MCAP file of another program (profile 'ros2', written by",
}


@pytest.mark.parametrize(("what", "words"), BAD.items(), ids=BAD.keys())
def test_what_is_no_recording_is_an_error(what: str, words: str, tmp_path: Path, shell: Shell) -> None:
    path = make(tmp_path, what)
    ended = shell("recordings", "info", path)
    assert ended.code == 2
    assert ended.err.startswith(f"viewsep: {path}: ")
    assert words in ended.err
    assert ended.out == ""


def test_of_several_files_the_others_are_told(data: bytes, tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "cut.mcap").write_bytes(data[:-9])
    files = (tmp_path / "missing.mcap", GOLDEN, tmp_path / "cut.mcap")
    ended = shell("recordings", "info", *files)
    assert ended.code == 2
    assert "missing.mcap: no such file" in ended.err
    assert re.findall(r": (\w+), [\d,]+ bytes", ended.out)[:1] == ["whole"]
    assert [said["state"] for said in shell("recordings", "info", *files, "--json").json] == [
        "no recording",
        "whole",
        "damaged",
    ]
    assert shell("recordings", "info", *files[1:]).code == 1


def test_sizes_are_those_of_the_decoded_pictures() -> None:
    for frame in golden().frames[:5]:
        assert jpeg_size(frame.jpeg) == frame.decode().image.shape[1::-1]
    for wrong in (b"", b"\xff\xd8", b"\xff\xd8\xff\xc0\x00", golden().frames[0].mask_png or b""):
        with pytest.raises(BadRecording, match="is not a JPEG"):
            jpeg_size(wrong)


def test_what_cannot_be_told_apart_is_told_with_the_view_that_would_help(tmp_path: Path, shell: Shell) -> None:
    below = np.array([0.0, 0.0, -1.0])
    twins = Result(
        *(9, Outcome.INDISTINGUISHABLE, "", "no view tells them apart", (), np.eye(3), 3, 0.5, 9),
        *(("tea", "decaf"), below, float(np.radians(4.2))),
    )
    with Recorder(tmp_path / "a.mcap", {"task": {"seed": "7"}}) as recorder:
        recorder.hear(9, twins)
    (said,) = shell("recordings", "info", tmp_path / "a.mcap", "--json").json
    assert (said["outcome"], said["object"], said["indistinct"]) == ("indistinguishable", None, ["tea", "decaf"])
    assert (said["telling_view_deg"], said["pose_spread_deg"]) == ([0.0, -90.0], pytest.approx(4.2))
    assert (
        "indistinguishable, tea or decaf: no view tells them apart; azimuth 0°, elevation -90° would, which it cannot "
        "reach (3 looks, 29 deg of travel, pose known to ±4°)"
    ) in shell("recordings", "info", tmp_path / "a.mcap").out


def test_a_number_that_is_no_seed_is_not_shown(tmp_path: Path, shell: Shell) -> None:
    with Recorder(tmp_path / "a.mcap", {"task": {"seed": "many"}, "config": {"json": "{"}}):
        pass
    (said,) = shell("recordings", "info", tmp_path / "a.mcap", "--json").json
    assert (said["seed"], said["rig"], said["candidates"]) == (None, None, [])


def test_the_golden_recording_holds_what_these_tests_expect() -> None:
    assert len(where(golden(), "percept")) == len(golden().frames) == 66
