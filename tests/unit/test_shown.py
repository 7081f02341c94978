"""A recording that is played has the status that the rig and its engine had."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from viewsep.cli.status_tables import tables
from viewsep.messages import Estimate, JointState, Outcome, Result
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.pacing import Item, Playback, in_order
from viewsep.recordings.reader import Recorded, Recording, read_recording
from viewsep.service.shown import Shown
from viewsep.service.status import ReplayStatus, Status, merge

GOLDEN = Path(__file__).parents[1] / "golden" / "v1.mcap"


@pytest.fixture(scope="module")
def golden() -> Recording:
    return read_recording(GOLDEN)


def shown(content: Recording, items: Sequence[Item] | None = None, end: bool = True) -> Shown:
    """What was shown after `items`, everything by default, were played."""
    playback = Playback(content, 0.0)
    now = Shown(content, GOLDEN, playback)
    now.begin()
    for _, item in zip(playback, list(in_order(content)) if items is None else items, strict=False):
        now.hear(item)
    if end:
        now.end()
    return now


def test_the_rig_stands_as_the_newest_read_back_says(golden: Recording) -> None:
    items = list(in_order(golden))[:600]
    states = [i.message for i in items if isinstance(i, Recorded) and isinstance(i.message, JointState)]
    stamps = [item.stamp_ns for item in items if isinstance(item, RecordedFrame)]
    rig = shown(golden, items, end=False).rig(("somebody",))
    assert [joint.name for joint in rig.motion.joints] == ["tilt", "pan"]
    assert [joint.position_deg for joint in rig.motion.joints] == list(np.degrees(states[-1].position_rad))
    assert [joint.setpoint_deg for joint in rig.motion.joints] == list(np.degrees(states[-1].setpoint_rad))
    assert (rig.simulated, rig.speed, rig.holds) == (True, 0.0, "product_7_twin_face")
    assert rig.clock_ns == max(item.stamp_ns for item in items)
    assert rig.camera.rate_hz == sum(stamp > rig.clock_ns - 2e9 for stamp in stamps) / 2
    assert rig.camera.newest_age_s == pytest.approx((rig.clock_ns - stamps[-1]) * 1e-9)
    assert rig.connections == ("somebody",)


def test_the_engine_believes_what_it_believed(golden: Recording) -> None:
    engine = shown(golden, end=False).engine()
    assert (engine.task, engine.owner, engine.seed, engine.result) == ("v1", "replay", 1, None)
    assert engine.looks == 33
    assert (
        {candidate.name for candidate in engine.candidates}
        == set(engine.models)
        == {
            "product_7",
            "product_7_twin_face",
        }
    )


def test_the_task_ends_with_the_recorded_result(golden: Recording) -> None:
    heard = next(r.message for r in golden.messages if isinstance(r.message, Result))
    engine = shown(golden).engine()
    assert (engine.task, engine.owner, engine.seed, engine.phase) == ("", "", None, "done")
    assert engine.result is not None
    assert (engine.result.task, engine.result.object, engine.result.reason) == ("v1", heard.object, heard.reason)
    assert engine.result.recording == str(GOLDEN)


def test_probabilities_and_what_cannot_be_told_apart_are_in_the_status(golden: Recording) -> None:
    heard: list[Recorded] = []
    for row in golden.messages:
        message = row.message
        if isinstance(message, Estimate):
            rated = tuple(replace(candidate, probability=0.4) for candidate in message.candidates)
            message = replace(message, candidates=rated, unknown=0.2)
        elif isinstance(message, Result):
            names, below = tuple(name for name, _ in message.ratings), np.array([0.0, 0.0, -1.0])
            told = replace(message, outcome=Outcome.INDISTINGUISHABLE, object="", indistinct=names)
            message = replace(told, telling_view=below, pose_spread_rad=float(np.radians(4.5)))
        heard.append(replace(row, message=message))
    engine = shown(replace(golden, messages=tuple(heard))).engine()
    assert ([candidate.probability for candidate in engine.candidates], engine.unknown) == ([0.4, 0.4], 0.2)
    assert engine.result is not None
    assert (engine.result.outcome, engine.result.object) == ("indistinguishable", None)
    assert engine.result.indistinct == ("product_7", "product_7_twin_face")
    assert engine.result.telling_view_deg == pytest.approx((0.0, -90.0))
    assert engine.result.pose_spread_deg == pytest.approx(4.5)
    without = shown(golden).engine()
    assert ({candidate.probability for candidate in without.candidates}, without.unknown) == ({None}, None)


def test_a_recording_that_ends_before_its_task_ends_it_as_failed(golden: Recording) -> None:
    result = shown(replace(golden, messages=golden.messages[:500])).engine().result
    assert result is not None
    assert (result.task, result.outcome) == ("v1", "failed")
    assert "ends before the task" in result.reason


def test_every_task_has_a_name_of_its_own(golden: Recording) -> None:
    twice = shown(replace(golden, messages=golden.messages * 2), end=False)
    assert twice.engine().task == "v1-2"
    ended = twice.engine().result
    assert ended is not None
    assert ended.task == "v1"
    twice.end()
    twice.begin()
    assert twice.task == "v1-3"


def test_what_a_recording_does_not_say_is_not_known(golden: Recording) -> None:
    bare = replace(golden, metadata={"config": {"json": '{"of": "another version"}'}}, frames=(), gaps=frozenset({7}))
    now = shown(bare)
    assert [joint.name for joint in now.rig(()).motion.joints] == ["joint 1", "joint 2"]
    assert not now.rig(()).camera.connected
    assert (now.engine().seed, now.engine().models) == (None, {})
    assert now.engine().faults == (f"messages are missing at 1 place of {GOLDEN}",)


def test_the_status_says_that_it_is_a_replay_and_an_older_one_says_nothing(golden: Recording) -> None:
    said = shown(golden).replay()
    assert said == ReplayStatus(file=str(GOLDEN), pace=0.0, position_s=17.6, duration_s=17.6)
    live = Status(name="bench", alive=("rig",), build={}, unix_ns=1)
    replayed = live.model_copy(update={"replay": said})
    assert merge([live, replayed]).replay == said
    assert Status.model_validate_json(replayed.to_json()) == replayed
    older = live.model_dump(by_alias=True, exclude={"replay"})
    assert Status.model_validate(older).replay is None
    out = Console(file=io.StringIO(), width=1000)
    out.print(*tables(replayed))
    assert isinstance(out.file, io.StringIO)
    assert f"of {GOLDEN}, as fast as possible: 17.6 of 17.6 s; nothing moves" in out.file.getvalue()
