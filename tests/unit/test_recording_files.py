"""Recordings over several files, on disks that fill up, and from the middle on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from recording_to_kill import GOLDEN, heard

from viewsep.config import RecordingConfig
from viewsep.errors import BadInput, BadRecording, ReplayMismatch
from viewsep.messages import Frame, HypothesisViews, Keyframe, Message, Result
from viewsep.recording import in_background, task_recorder
from viewsep.recordings.codec import to_bytes
from viewsep.recordings.part_file import PartFile
from viewsep.recordings.reader import Recording, joined, read_recording
from viewsep.recordings.recovery import recover
from viewsep.recordings.replay import Verification, restore, start_at, verify
from viewsep.recordings.writer import Recorder

Heard = list[tuple[int, Message]]


@pytest.fixture(scope="module")
def messages() -> Heard:
    return list(heard())


def recorder(path: Path, **settings: float) -> Recorder:
    config, models = restore(read_recording(GOLDEN))
    return task_recorder(path, config.model_copy(update={"recording": RecordingConfig(**settings)}), models, 1, "")


def record(path: Path, messages: Heard, **settings: float) -> list[Path]:
    with recorder(path, **settings) as writing:
        for stamp_ns, message in messages:
            writing.hear(stamp_ns, message)
    return writing.paths


@pytest.fixture(scope="module")
def whole(messages: Heard, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    (path,) = record(tmp_path_factory.mktemp("whole") / "a.mcap", messages)
    return read_recording(path)


def raws(recording: Recording) -> list[bytes]:
    return [recorded.raw for recorded in recording.messages]


# ---- several files ----


def test_every_file_can_be_replayed_alone_and_all_together(messages: Heard, whole: Recording, tmp_path: Path) -> None:
    paths = record(tmp_path / "a.mcap", messages, rotate_mb=0.4)
    assert [path.name for path in paths] == ["a.mcap", *(f"a-{n}.mcap" for n in range(2, len(paths) + 1))]
    assert len(paths) > 2
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    parts = [read_recording(path) for path in paths]
    for number, part in enumerate(parts, 1):
        assert part.attachments == whole.attachments
        assert part.metadata["session"]["part"] == str(number)
        assert verify(part).skipped == 0
    together = joined(parts)
    assert raws(together) == raws(whole)
    assert together.frames == whole.frames
    assert together.gaps == set()
    assert verify(together) == verify(whole)


def test_files_of_different_recordings_are_not_joined(messages: Heard, whole: Recording, tmp_path: Path) -> None:
    parts = [read_recording(path) for path in record(tmp_path / "a.mcap", messages, rotate_mb=0.4)]
    assert joined(list(reversed(parts))).messages == joined(parts).messages
    with pytest.raises(BadRecording, match="not parts of one recording"):
        joined([parts[0], whole])
    missing = joined([parts[0], *parts[2:]])
    assert len(missing.gaps) == 1
    assert verify(missing).gaps == 1


def test_files_are_begun_by_time_too(messages: Heard, tmp_path: Path) -> None:
    assert len(record(tmp_path / "a.mcap", messages, rotate_s=1e-9)) == 1 + sum(
        isinstance(message, Keyframe) for _, message in messages
    )


def test_a_next_file_that_exists_ends_the_recording(messages: Heard, tmp_path: Path) -> None:
    (tmp_path / "a-2.mcap").write_bytes(b"precious")
    with pytest.raises(BadInput, match=r"a-2\.mcap: exists already"):
        record(tmp_path / "a.mcap", messages, rotate_mb=0.4)
    assert (tmp_path / "a-2.mcap").read_bytes() == b"precious"
    verify(read_recording(tmp_path / "a.mcap"))


# ---- disks ----


def test_what_was_heard_is_on_the_disk_before_the_end(messages: Heard, tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap", sync_s=0.05) as writing:
        for stamp_ns, message in messages[:200]:
            writing.hear(stamp_ns, message)
        writing._sync_due = 0.0
        writing.tick()
        (tmp_path / "copy.mcap").write_bytes((tmp_path / "a.mcap.part").read_bytes())
    saved = recover(tmp_path / "copy.mcap")
    assert saved is not None
    kept = [to_bytes(message) for _, message in messages[:200] if not isinstance(message, Frame | HypothesisViews)]
    assert raws(read_recording(saved.path)) == kept


def hear_and_sync(writing: Recorder, messages: Heard) -> None:
    for stamp_ns, message in messages:
        writing._sync_due = 0.0
        writing.hear(stamp_ns, message)


def test_a_disk_that_is_nearly_full_ends_the_recording_in_good_order(
    messages: Heard, whole: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = [10**9] * 3 + [10**6]
    monkeypatch.setattr(PartFile, "free_bytes", lambda _part: free.pop(0) if len(free) > 1 else free[0])
    with recorder(tmp_path / "a.mcap", min_free_mb=50, sync_s=0.05) as writing:
        ended = pytest.raises(BadInput, match=r"has ended, as only 1 MB of the disk are left .*recording\.min_free_mb")
        with ended:
            hear_and_sync(writing, messages)
        writing.hear(*messages[0])  # what comes after is not recorded
    kept = raws(read_recording(tmp_path / "a.mcap"))
    assert kept == raws(whole)[: len(kept)]
    with pytest.raises(BadInput, match=r"b\.mcap: cannot be recorded, as only 1 MB"):
        recorder(tmp_path / "b.mcap", min_free_mb=50).open()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_an_error_of_the_recorder_reaches_the_one_who_talks(messages: Heard, tmp_path: Path) -> None:
    (tmp_path / "a-2.mcap").write_bytes(b"precious")
    config, models = restore(read_recording(GOLDEN))
    config = config.model_copy(update={"recording": RecordingConfig(rotate_mb=0.5)})
    told: list[Exception] = []
    writing = task_recorder(tmp_path / "a.mcap", config, models, 1, "")
    with in_background(writing, config, told.append, patience_s=10.0) as queued:
        for stamp_ns, message in messages:
            queued.hear(stamp_ns, message)
    assert [type(error) for error in told] == [BadInput]
    assert queued.error is told[0]
    assert queued.lost > 0


def test_what_was_lost_on_the_way_is_in_the_file(messages: Heard, tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as writing:
        writing.hear(*messages[0])
        writing.lost = 3
    assert read_recording(tmp_path / "a.mcap").metadata["lost"] == {"messages": "3"}


# ---- keyframes ----


def test_a_replay_from_any_keyframe_matches(whole: Recording) -> None:
    keyframes = [recorded for recorded in whole.messages if isinstance(recorded.message, Keyframe)]
    all_of_it = verify(whole)
    assert all_of_it.keyframes == len(keyframes) > 5
    for number, keyframe in enumerate(keyframes):
        found = verify(start_at(whole, keyframe.stamp_ns))
        assert found.exact
        assert found.keyframes == len(keyframes) - number - 1
        assert 0 < found.outputs < all_of_it.outputs
    assert verify(start_at(whole, keyframes[3].stamp_ns + 1)) == verify(start_at(whole, keyframes[3].stamp_ns))
    with pytest.raises(BadRecording, match="its first is at"):
        start_at(whole, keyframes[0].stamp_ns - 1)
    with pytest.raises(BadRecording, match="it has none"):
        start_at(read_recording(GOLDEN), 10**12)


def test_a_changed_state_is_noticed(whole: Recording) -> None:
    places = [place for place, recorded in enumerate(whole.messages) if isinstance(recorded.message, Keyframe)]
    changed = list(whole.messages)
    changed[places[2]], changed[places[4]] = (
        replace(changed[a], message=changed[b].message) for a, b in ((places[2], places[4]), (places[4], places[2]))
    )
    with pytest.raises(ReplayMismatch, match="the engine's state at"):
        verify(replace(whole, messages=tuple(changed)))


def test_after_a_gap_verification_goes_on_at_the_next_keyframe(whole: Recording) -> None:
    topics = [recorded.topic for recorded in whole.messages]
    place = next(n for n in range(100, len(topics)) if topics[n : n + 2] == ["percept", "estimate"])
    cut = replace(whole, messages=(*whole.messages[:place], *whole.messages[place + 1 :]), gaps=frozenset({place}))
    found = verify(cut)
    assert isinstance(found, Verification)
    assert found.gaps == 1
    assert 0 < found.skipped < 120
    assert any(isinstance(recorded.message, Result) for recorded in cut.messages)
    assert found.outputs < verify(whole).outputs
