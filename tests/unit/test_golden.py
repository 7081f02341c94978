"""Recordings of every layout there has been are read, verified and recomputed; `make golden` makes the newest."""

from __future__ import annotations

from pathlib import Path

import pytest

from viewsep.config import Config
from viewsep.messages import Outcome, Result
from viewsep.recordings.build import this_build
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import replay, restore, verify, verify_frames
from viewsep.recordings.version import VERSION

FOLDER = Path(__file__).parents[1] / "golden"
GOLDEN = sorted(FOLDER.glob("v*.mcap"))
DEFAULTS = FOLDER / "defaults.mcap"


def test_there_is_one_of_every_layout() -> None:
    assert [path.name for path in GOLDEN] == [f"v{version}.mcap" for version in range(1, VERSION + 1)]
    assert all(path.stat().st_size < 3_000_000 for path in GOLDEN)


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_its_decisions_and_percepts_are_repeated(path: Path) -> None:
    recording = read_recording(path)
    assert int(recording.metadata["session"].get("version", "1")) == int(path.stem[1:])
    found = verify(recording)
    assert found.outputs > 50
    assert found.skipped == found.gaps == 0
    same_build = recording.metadata["build"] == this_build()
    assert (found.keyframes > 2) == (path.stem != "v1" and same_build)
    assert verify_frames(recording).percepts > 50
    (recorded,) = [row.message for row in recording.messages if isinstance(row.message, Result)]
    *_, last = replay(recording)
    assert last.state.result is not None
    assert (last.state.result.outcome, last.state.result.object) == (Outcome.IDENTIFIED, recorded.object)


def test_so_are_those_of_the_default_method() -> None:
    recording = read_recording(DEFAULTS)
    assert DEFAULTS.stat().st_size < 3_000_000
    config, models = restore(recording)
    defaults = Config()
    for kind in ("descriptor", "interpreter", "planner"):
        assert getattr(config, kind) == getattr(defaults, kind)
    assert [model.descriptor for model in models] == [defaults.descriptor.name] * 2
    if recording.metadata["build"] == this_build():  # its probabilities are in single precision: elsewhere close only
        found = verify(recording)
        assert found.outputs > 10
        assert found.skipped == found.gaps == 0
        assert found.keyframes > 1
    assert verify_frames(recording).percepts >= 10
    (recorded,) = [row.message for row in recording.messages if isinstance(row.message, Result)]
    *_, last = replay(recording)
    assert last.state.result is not None
    assert (last.state.result.outcome, last.state.result.object) == (Outcome.IDENTIFIED, recorded.object)
