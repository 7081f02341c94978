"""A recording that was cut off or damaged: what is left of it is saved, and nothing else is touched."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import recording_to_kill
from recording_to_kill import GOLDEN, SYNC_S, heard

from viewsep.errors import BadInput, BadRecording
from viewsep.messages import Frame, HypothesisViews, Message
from viewsep.recording import task_recorder
from viewsep.recordings.codec import to_bytes
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.recovery import recover, recovered_path, unfinished
from viewsep.recordings.replay import restore, verify

KILLS = 20


@pytest.fixture(scope="module")
def messages() -> list[tuple[int, Message]]:
    return list(heard())


@pytest.fixture(scope="module")
def whole(messages: list[tuple[int, Message]], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The golden task as it is recorded today."""
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    config, models = restore(read_recording(GOLDEN))
    with task_recorder(path, config, models, 1, "") as recorder:
        for number, (stamp_ns, message) in enumerate(messages):
            recorder.hear(stamp_ns, message)
            if number % 100 == 99:  # so that there are chunks to lose
                recorder._sync_due = 0.0
    return path.read_bytes()


def raws(recording: Recording) -> list[bytes]:
    return [recorded.raw for recorded in recording.messages]


# ---- killed ----


@pytest.fixture(scope="module")
def server() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, recording_to_kill.__file__]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
        process.stdin.close()  # type: ignore[union-attr]
        process.wait(10)


def recorded_until_killed(server: subprocess.Popen[str], path: Path, rotate_mb: float, after_s: float) -> list[float]:
    """Have a child record to `path`, kill it after a while; when every message was heard."""
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(f"{path} {rotate_mb}\n")
    server.stdin.flush()
    child = int(server.stdout.readline().split()[1])
    time.sleep(after_s)
    os.kill(child, signal.SIGKILL)
    times = []
    while (line := server.stdout.readline()) != "ended\n":
        times.append(float(line.split()[1]))
    return times


@pytest.mark.parametrize(
    "seed", [0, 1, 2, 3, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(4, KILLS))]
)
def test_a_kill_costs_no_more_than_the_last_moments(
    seed: int, server: subprocess.Popen[str], messages: list[tuple[int, Message]], tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    rotate_mb = 0.0 if seed % 2 else 0.4  # of which 0.3 are the models
    times = recorded_until_killed(server, tmp_path / "a.mcap", rotate_mb, rng.uniform(0.02, 0.9))
    for part in unfinished(tmp_path):
        saved = recover(part)
        assert saved is not None
        assert unfinished(tmp_path) == []
    complete = sorted(tmp_path.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    recordings = [read_recording(path) for path in complete]
    kept = [raw for recording in recordings for raw in raws(recording)]
    told = [message for _, message in messages if not isinstance(message, Frame | HypothesisViews)]
    assert kept == [to_bytes(message) for message in told[: len(kept)]]
    # what was heard before the last moments is there
    old = sum(stamp < times[-1] - SYNC_S for stamp in times) if times else 0
    due = messages[:old]
    assert len(kept) >= sum(not isinstance(message, Frame) for _, message in due)
    pictures = sum(len(recording.frames) for recording in recordings)
    assert pictures >= sum(isinstance(message, Frame) for _, message in due)
    for recording in recordings:
        if any(recorded.topic == "percept" for recorded in recording.messages):
            found = verify(recording)
            assert found.exact
            assert found.skipped == 0


# ---- damaged ----


def check_saved(path: Path, original: Recording) -> None:
    """Whatever was saved was recorded, stands in order, and replays as far as it goes."""
    recording = read_recording(path)
    known = {raw: place for place, raw in enumerate(raws(original))}
    places = [known[raw] for raw in raws(recording)]
    assert places == sorted(places)
    assert len(recording.gaps) == sum(b != a + 1 for a, b in zip([-1, *places], places, strict=False))
    pictures = {frame.jpeg for frame in original.frames}
    assert all(frame.jpeg in pictures for frame in recording.frames)
    complete = recording.metadata.keys() >= {"config", "models", "task"} and len(recording.attachments) == 2
    if complete and any(recorded.topic == "percept" for recorded in recording.messages):
        verify(recording)


@pytest.mark.parametrize("kind", ["cut", "flipped"])
@pytest.mark.parametrize("files", [15, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_files_are_refused_and_saved(kind: str, files: int, whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "whole.mcap").write_bytes(whole)
    original = read_recording(tmp_path / "whole.mcap")
    rng = np.random.default_rng(len(kind))
    path = tmp_path / "damaged.mcap"
    nothing_left = 0
    for number, position in enumerate(rng.integers(0, len(whole), files)):
        damaged = bytearray(whole)
        if kind == "cut":
            damaged = damaged[:position]
        else:
            damaged[position] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        with pytest.raises(BadRecording, match=r"damaged\.mcap: "):
            read_recording(path)
        try:
            saved = recover(path)
        except BadRecording:
            nothing_left += 1
            continue
        assert saved is not None
        assert path.read_bytes() == damaged
        if number % 10 == 0:
            check_saved(saved.path, original)
        else:
            read_recording(saved.path)
        saved.path.unlink()
    assert nothing_left <= (4 if kind == "cut" else 1)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["damaged.mcap", "whole.mcap"]


def test_what_was_lost_is_told(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(whole)
    original = read_recording(path)
    place = whole.index(original.frames[5].jpeg)
    path.write_bytes(whole[:place] + b"\0" + whole[place + 1 :])
    saved = recover(path)
    assert saved is not None
    (lost,) = saved.lost
    assert lost.what == "chunk"
    assert lost.start < place < lost.end
    assert lost.span_ns is not None
    assert lost.span_ns[0] <= original.frames[5].stamp_ns <= lost.span_ns[1]
    assert lost.messages["camera/image"] == len(original.frames) - saved.messages["camera/image"] > 0
    assert saved.messages["percept"] == sum(recorded.topic == "percept" for recorded in original.messages)
    assert saved.span_ns is not None
    assert raws(read_recording(saved.path)) == raws(original)


def test_recovering_again_changes_nothing(whole: bytes, tmp_path: Path) -> None:
    part = tmp_path / "run.mcap.part"
    part.write_bytes(whole[:-5000])
    assert unfinished(tmp_path) == [part]
    first = recover(part)
    assert first is not None
    assert not first.already
    data = first.path.read_bytes()
    again = recover(part)
    assert again is not None
    assert again.already
    assert again.messages == first.messages
    assert first.path.read_bytes() == data
    assert part.read_bytes() == whole[:-5000]
    assert unfinished(tmp_path) == []
    first.path.unlink()
    assert recover(part) == first
    assert first.path.read_bytes() == data


def test_a_whole_file_needs_no_recovery(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(whole)
    assert recover(tmp_path / "a.mcap") is None
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_what_cannot_be_saved_is_said(whole: bytes, tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match="no such file"):
        recover(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("a text")
    with pytest.raises(BadRecording, match="does not start as an MCAP file"):
        recover(tmp_path / "text.mcap")
    (tmp_path / "short.mcap").write_bytes(whole[:20])
    with pytest.raises(BadRecording, match="nothing to save"):
        recover(tmp_path / "short.mcap")
    damaged = tmp_path / "a.mcap"
    damaged.write_bytes(whole[:-1])
    recovered_path(damaged).write_bytes(b"precious")
    with pytest.raises(BadInput, match=r"a\.recovered\.mcap: is there already"):
        recover(damaged)
    assert recovered_path(damaged).read_bytes() == b"precious"


def test_a_file_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    config, models = restore(read_recording(GOLDEN))
    with task_recorder(tmp_path / "a.mcap", config, models, 1, ""):
        part = tmp_path / "a.mcap.part"
        assert unfinished(tmp_path) == []
        with pytest.raises(BadInput, match="is being written"):
            recover(part)
        for overwrite in (False, True):
            with pytest.raises(BadInput, match="is being written by another process"):
                task_recorder(tmp_path / "a.mcap", config, models, 1, "", overwrite=overwrite).open()
    assert read_recording(tmp_path / "a.mcap").messages == ()
