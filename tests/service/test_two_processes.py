"""Rig and engine in two processes: the same answers and the same bytes as in one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from processes import Serving, serving, split, until

from viewsep.messages import JointState
from viewsep.recordings.codec import to_bytes
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.service.status import ResultStatus


def result_of(*services: Serving, seed: int) -> ResultStatus:
    """What the service says of one task."""
    with serving(*services), services[0].client() as client:
        until(lambda: client.status().engine, 10, "the engine is not there")
        return client.wait(client.start(seed=seed), timeout_s=120)


def crossed(recording: Path) -> list[bytes]:
    """What the engine took and gave, in order."""
    messages = (recorded.message for recorded in read_recording(recording).messages)
    return [to_bytes(message) for message in messages if not isinstance(message, JointState)]


@pytest.mark.parametrize(
    ("chosen", "fewest"), [("seed_settings", 100), pytest.param("settings", 10, marks=pytest.mark.long)]
)
def test_two_processes_give_the_bytes_of_one(
    request: pytest.FixtureRequest, tmp_path: Path, chosen: str, fewest: int
) -> None:
    settings = request.getfixturevalue(chosen)
    stepped = {**settings, "service": {**settings["service"], "speed": 0.0}}
    alone = result_of(Serving(tmp_path / "one", stepped), seed=1)
    apart = result_of(*split(stepped, tmp_path / "two", recordings=str(tmp_path / "apart")), seed=1)
    assert alone.outcome == "identified"
    assert alone.object == "product_7"
    told = {"task", "recording"}
    assert apart.model_dump(exclude=told) == alone.model_dump(exclude=told)
    assert alone.recording is not None
    assert apart.recording is not None
    assert crossed(Path(alone.recording)) == crossed(Path(apart.recording))
    assert len(crossed(Path(alone.recording))) > fewest
    verify(read_recording(Path(apart.recording)))


@pytest.mark.parametrize("send", ["image", pytest.param("crop", marks=pytest.mark.long), "descriptor"])
def test_whatever_a_look_sends_the_object_is_found(settings: Mapping[str, Any], tmp_path: Path, send: str) -> None:
    found = result_of(*split(settings, tmp_path, send=send), seed=1)
    assert (found.outcome, found.object) == ("identified", "product_7")
    assert found.recording is not None
    content = read_recording(Path(found.recording))
    verify(content)
    assert bool(content.frames) == (send != "descriptor")


def test_the_order_of_starting_does_not_matter(settings: Mapping[str, Any], tmp_path: Path) -> None:
    rig, engine = split(settings, tmp_path)
    with serving(engine), serving(rig), engine.client() as client:
        until(lambda: client.status().rig, 10, "the rig is not there")
        task = client.start(seed=1)
        client.cancel()
        assert client.wait(task, timeout_s=30).reason == "cancelled: by tester"
