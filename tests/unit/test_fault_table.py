"""The fault table of docs/faults.md: what goes wrong in a task or in learning is noticed, recorded and said."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from staged_rig import CAMERA_GONE, CONFIG, MOTORS_GONE, STAGING, Scenario, perception_of, task_on

from viewsep.capture.lesson import Lesson, photograph, shots_of
from viewsep.cli.exit_codes import EXIT_CODES
from viewsep.errors import RigError
from viewsep.learning import learn_view_set
from viewsep.messages import (
    Command,
    Estimate,
    FrameMissing,
    Message,
    MoveTo,
    Outcome,
    PerceptReceived,
    Result,
    RigFailed,
    Stop,
)
from viewsep.models.aspect_graph import AspectGraph
from viewsep.models.library import load_library
from viewsep.plots.events import happenings
from viewsep.plots.story import retell
from viewsep.plugins import make_descriptor
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.staged_camera import Delivery
from viewsep.sim.view_set import read_view_set

pytestmark = pytest.mark.needs_pybullet
BOX, TWIN = "generated:7", "generated:7:twin=face"
NAMES = {BOX: "product_7", TWIN: "product_7_twin_face"}
ON_THE_RIG = Scenario(BOX)
SOON_S = 1.2  # after four looks


@dataclass(frozen=True)
class Row:
    """A row of the table: what goes wrong, how the task ends, and what is recorded of it."""

    fault: str
    scenario: Scenario
    outcome: Outcome
    sentence: str
    recorded: type[Message] = FrameMissing
    shown: str = BOX

    @property
    def code(self) -> int:
        return EXIT_CODES[self.outcome]


def staged(**changes: Any) -> Scenario:
    return replace(ON_THE_RIG, staging=replace(STAGING, **changes))


ROWS = [
    Row(
        "removed",
        staged(removed_s=SOON_S),
        Outcome.FAILED,
        r"20 frames missing in a row, for 5\.\d s: the object is gone, no object stands out .*: put it back",
    ),
    Row(
        "removed and put back",
        staged(removed_s=SOON_S, put_back_s=4.0),
        Outcome.IDENTIFIED,
        r"after \d looks; the object was gone for 2\.\d s: what was seen before does not count",
    ),
    Row(
        "exchanged",
        replace(staged(removed_s=2.0, put_back_s=4.0), exchanged_for=TWIN, exchanged_s=3.0, seed=6),
        Outcome.IDENTIFIED,
        r"the object was gone for 2\.\d s: what was seen before does not count",
        shown=TWIN,
    ),
    Row(
        "light dimmed",
        staged(switched_s=SOON_S, switched_slope=(0.0, 0.0)),
        Outcome.IDENTIFIED,
        r"after \d looks; the light has changed: pictures are 0\.6 times as bright as before",
        Estimate,
    ),
    Row(
        "other lamps",
        staged(switched_s=SOON_S),
        Outcome.FAILED,
        r"20 frames missing in a row, for 5\.\d s: 6\d% of the picture around the object is not as it was .*: the "
        "light or the camera changed; capture it again",
    ),
    Row(
        "slipped",
        replace(ON_THE_RIG, disturbances=Disturbances(slip_deg=30.0, slip_after_s=3.5), seed=7),
        Outcome.IDENTIFIED,
        r"after \d+ looks, on the way its pose changed as if it had slipped",
        Estimate,
    ),
    Row(
        "camera stalled",
        replace(ON_THE_RIG, delivery=Delivery(stalled_s=SOON_S)),
        Outcome.FAILED,
        r"20 frames missing in a row, for 2\d\.\d s: the staged camera delivered no frame within 1 s",
    ),
    Row(
        "camera stalled for a while",
        replace(ON_THE_RIG, delivery=Delivery(stalled_s=SOON_S, goes_on_s=6.0)),
        Outcome.IDENTIFIED,
        r"3 frames missing in a row, for \d\.\d s: the staged camera delivered no frame within 1 s",
    ),
    Row(
        "camera stalled for longer than anybody remembers",
        replace(ON_THE_RIG, delivery=Delivery(stalled_s=SOON_S, goes_on_s=14.0)),
        Outcome.IDENTIFIED,
        r"there was no picture of the object for 1\d\.\d s: what was seen before does not count",
    ),
    Row("camera unplugged", replace(ON_THE_RIG, camera_gone_s=SOON_S), Outcome.FAILED, f"^{CAMERA_GONE}$", RigFailed),
    Row("motors unplugged", replace(ON_THE_RIG, motors_gone_s=SOON_S), Outcome.FAILED, f"^{MOTORS_GONE}$", RigFailed),
    Row(
        "over-exposed",
        staged(gain=2.0),
        Outcome.FAILED,
        r"the picture is over-exposed, \d\d% of it is clipped: lower the exposure or the gain",
    ),
    Row(
        "a little over-exposed",
        replace(staged(gain=1.5), seed=3),
        Outcome.IDENTIFIED,
        r"after \d+ looks; more than 25% of the object is burnt out: lower the exposure or the gain",
        Estimate,
    ),
    Row(
        "too dark",
        staged(gain=0.1),
        Outcome.FAILED,
        r"the picture is too dark, half of it is below 1\d of 255: raise the exposure, or add light",
    ),
]


@pytest.fixture(scope="module")
def models(look_alikes: Path) -> list[AspectGraph]:
    return load_library(look_alikes)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.fault)
def test_in_a_task(row: Row, models: list[AspectGraph], tmp_path: Path) -> None:
    told = task_on(row.scenario, models, tmp_path / "task.mcap")
    assert (told.result.outcome, row.code) == (row.outcome, 4 if row.outcome is Outcome.FAILED else 0)
    assert re.search(row.sentence, told.result.reason), told.result.reason
    assert told.result.object == (NAMES[row.shown] if row.outcome is Outcome.IDENTIFIED else "")
    assert [result.reason for result in told.of(Result)] == [told.result.reason]
    assert isinstance([message for message in told.messages if isinstance(message, Command)][-1], Stop)
    assert told.of(row.recorded)
    if row.recorded is Estimate:
        notes = [estimate.note for estimate in told.of(Estimate) if estimate.note]
        trouble = [
            happening.words for happening in happenings(retell(told.recording))[0] if happening.kind == "trouble"
        ]
        assert len(notes) > 0
        assert trouble == [f"Out of the ordinary: {note}." for note in dict.fromkeys(notes)]
    for missing in told.of(FrameMissing)[3:4]:  # the rig does not drive on blindly
        later = told.messages[told.messages.index(missing) :]
        until = next((k for k, message in enumerate(later) if isinstance(message, PerceptReceived)), None)
        assert not any(isinstance(message, MoveTo) for message in later[:until])


def test_a_task_in_which_nothing_goes_wrong_has_nothing_to_report(models: list[AspectGraph], tmp_path: Path) -> None:
    told = task_on(ON_THE_RIG, models, tmp_path / "task.mcap")
    assert told.result.reason == f"its probability is 1.0000 after {told.result.looks} looks"
    assert told.of(FrameMissing) == []
    assert [estimate.note for estimate in told.of(Estimate) if estimate.note] == []
    assert all(received.percept.notes == () for received in told.of(PerceptReceived))


# ---- learning on the rig ----


LESSON = Lesson("tea", Path(), spacing_deg=40.0)
TURNTABLE = replace(ON_THE_RIG, preset="turntable")
LATER_S = 6.0


def photographed(scenario: Scenario, folder: Path) -> tuple[Lesson, int]:
    """The lesson, and how many photos there are."""
    rig = scenario.rig()
    lesson = replace(LESSON, folder=folder)
    _, count = photograph(lesson, rig, perception_of(rig, scenario.preset), "here")
    return lesson, count


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> AspectGraph:
    lesson, count = photographed(TURNTABLE, tmp_path_factory.mktemp("lesson"))
    assert count == len(shots_of(lesson, TURNTABLE.rig()))
    return learn_view_set(lesson.photos, lesson.name, CONFIG)


@pytest.mark.parametrize(
    ("scenario", "sentence"),
    [
        (replace(TURNTABLE, camera_gone_s=LATER_S), CAMERA_GONE),
        (replace(TURNTABLE, motors_gone_s=LATER_S), MOTORS_GONE),
        (
            replace(TURNTABLE, delivery=Delivery(stalled_s=LATER_S)),
            r"no picture came in 3 attempts: the staged camera delivered no frame within 2 s; is the camera plugged in",
        ),
        (
            replace(TURNTABLE, staging=replace(STAGING, removed_s=LATER_S)),
            r"photos .*could not be used, the last one: the object is gone",
        ),
    ],
    ids=["camera unplugged", "motors unplugged", "camera stalled", "object removed"],
)
def test_learning_that_breaks_off_goes_on_with_the_same_views(
    scenario: Scenario, sentence: str, uninterrupted: AspectGraph, tmp_path: Path
) -> None:
    lesson = replace(LESSON, folder=tmp_path)
    with pytest.raises(RigError, match=rf"{sentence}.*photos are kept in .*the same command goes on") as broken:
        photographed(scenario, tmp_path)
    kept = {path.name: path.read_bytes() for path in (lesson.photos / "images").iterdir()}
    assert 2 <= len(kept) < len(uninterrupted.directions)
    assert f"{len(kept)} of {len(shots_of(lesson, scenario.rig()))} photos" in str(broken.value)
    photographed(TURNTABLE, tmp_path)
    assert all((lesson.photos / "images" / name).read_bytes() == data for name, data in kept.items())
    model = learn_view_set(lesson.photos, lesson.name, CONFIG)
    np.testing.assert_allclose(model.directions, uninterrupted.directions, atol=0.01)
    descriptor = make_descriptor(CONFIG.descriptor)
    alike = [descriptor.similarity(*pair) for pair in zip(model.features, uninterrupted.features[:, None], strict=True)]
    assert min(alike) > 0.9


@pytest.mark.parametrize(
    ("gain", "sentence"),
    [
        (2.0, r"6 of 6 photos could not be used, .*over-exposed, \d\d% of it is clipped: lower the exposure"),
        (0.1, r"6 of 6 photos could not be used, .*too dark, half of it is below 1\d of 255: raise the exposure"),
    ],
)
def test_wrongly_exposed_photos_are_not_learned_from(gain: float, sentence: str, tmp_path: Path) -> None:
    scenario = replace(TURNTABLE, staging=replace(STAGING, gain=gain))
    with pytest.raises(RigError, match=sentence):
        photographed(scenario, tmp_path)
    assert list((tmp_path / "placement_1" / "images").iterdir()) == []


def test_photos_on_which_the_object_is_burnt_out_are_left_out(tmp_path: Path) -> None:
    scenario = replace(TURNTABLE, staging=replace(STAGING, gain=1.3), seed=3)
    rig, lesson = scenario.rig(), replace(LESSON, folder=tmp_path, spacing_deg=20.0)
    skipped, count = photograph(lesson, rig, perception_of(rig, "turntable"), "here")
    assert any("burnt out: lower the exposure" in one.problem for one in skipped)
    assert len(read_view_set(lesson.photos).images) == count == len(shots_of(lesson, rig)) - len(skipped)
