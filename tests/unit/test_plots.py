"""Contact sheets, view spheres and reports: pictures that can be read, from whatever a recording holds."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from seed_method import SEED
from told_tasks import model, record, way

from viewsep.config import Config, parse_config
from viewsep.errors import BadInput
from viewsep.geometry import fibonacci_sphere
from viewsep.messages import (
    Array,
    CancelRequested,
    DeadlinePassed,
    Frame,
    Message,
)
from viewsep.perception import RigPerception
from viewsep.plots.contact_sheet import contact_sheet, sheet_order
from viewsep.plots.report import report
from viewsep.plots.sphere import SphereView, along_arcs, draw_globe, draw_path
from viewsep.plots.story import retell
from viewsep.plugins import make_descriptor
from viewsep.recording import task_recorder
from viewsep.recordings.reader import Recording, read_recording


def read_png(path: Path) -> Array:
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG\r\n")
    assert 5_000 < len(data) < 1_000_000
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.std() > 5
    return image


# Contact sheets


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_contact_sheet_grows_with_the_models(tmp_path: Path, count: int) -> None:
    contact_sheet([model(f"object_{i}", i) for i in range(count)], tmp_path / "sheet.png")
    height, width = read_png(tmp_path / "sheet.png").shape[:2]
    assert (width > 1500) == (count == 5)
    assert (height > 400) == (count == 5)
    assert [p.name for p in tmp_path.iterdir()] == ["sheet.png"]


def test_large_models_show_a_hundred_views(tmp_path: Path) -> None:
    hundred, more = model("hundred", 1, 100), model("n" * 100, 2, 150, directions=fibonacci_sphere(150))
    contact_sheet([hundred], tmp_path / "a.png")
    contact_sheet([more], tmp_path / "b.png")
    assert read_png(tmp_path / "a.png").shape == read_png(tmp_path / "b.png").shape


def test_views_are_ordered_from_the_top_by_azimuth() -> None:
    directions = fibonacci_sphere(100)
    order = sheet_order(directions)
    assert sorted(order) == list(range(100))
    height = directions[order, 2]
    assert height[:5].min() > 0.8
    assert height[-5:].max() < -0.8


def test_no_models_make_no_sheet(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no models"):
        contact_sheet([], tmp_path / "sheet.png")


def test_a_place_that_cannot_be_written_is_named_and_left_clean(tmp_path: Path) -> None:
    recording = record(tmp_path / "a.mcap", way(0))
    (tmp_path / "folder.png").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for path in (tmp_path / "none" / "x.png", tmp_path / "folder.png", tmp_path / "a.mcap" / "x.png"):
        with pytest.raises(BadInput, match=path.name):
            contact_sheet([model("a", 1)], path)
        with pytest.raises(BadInput, match=path.name):
            report(recording, path)
    assert sorted(tmp_path.rglob("*")) == before


# Spheres


@pytest.mark.parametrize("towards", [(1, 0, 0), (0, 0, 1), (0, 0, -1), (-0.3, 0.2, 0.9), (0, -1, -0.1)])
def test_a_view_faces_what_it_should_and_behind_shows_the_rest(towards: tuple[float, float, float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    view = SphereView.facing(direction[None])
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.axes) == pytest.approx(1.0)
    assert view.axes[2] @ direction > 0.9
    assert view.axes[1, 2] >= -1e-12
    nodes = fibonacci_sphere(50)
    assert (view.project(nodes)[1] ^ view.from_behind().project(nodes)[1]).all()


def test_directions_that_cancel_still_give_a_view() -> None:
    ring = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    for directions in (ring, np.empty((0, 3))):
        np.testing.assert_allclose(np.linalg.norm(SphereView.facing(directions).axes, axis=1), 1.0)


def test_paths_follow_great_circles_and_may_stand_still() -> None:
    stops = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    dense = along_arcs(stops)
    np.testing.assert_allclose(np.linalg.norm(dense, axis=1), 1.0)
    np.testing.assert_allclose(dense[[0, -1]], stops[[0, -1]])
    assert len(dense) == 31
    assert along_arcs(stops[:1]).shape == (1, 3)
    assert along_arcs(stops[:0]).shape == (0, 3)


def test_hidden_parts_are_drawn_only_on_request() -> None:
    axes = Figure().add_subplot()
    view = SphereView.facing(np.array([[0.0, 0, 1]]))
    draw_globe(axes, view)
    before = len(axes.lines)
    hidden = np.array([[0.6, 0, -0.8], [0, 0.6, -0.8]])
    draw_path(axes, view, hidden, colour="k", width=1.0)
    assert len(axes.lines) == before
    draw_path(axes, view, hidden, colour="k", width=1.0, behind=0.3)
    assert len(axes.lines) == before + 1


# Reports


ENDINGS: dict[str, list[Message]] = {
    "nothing": [],
    "started": way(0),
    "cancelled before any percept": [*way(0), CancelRequested(99, "by $x^{ the operator")],
    "one look": [*way(1), DeadlinePassed(99)],
    "unfinished": way(9),
    "undecided": [*way(9), DeadlinePassed(99)],
    "failed": [*way(9), CancelRequested(99, "the door is open")],
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_ending_has_a_report(tmp_path: Path, ending: str) -> None:
    report(record(tmp_path / "a.mcap", ENDINGS[ending]), tmp_path / "a.png")
    assert read_png(tmp_path / "a.png").shape == (1200, 1600, 3)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "a.png"]


@pytest.mark.parametrize("candidates", [2, 3, 12])
def test_a_posterior_has_a_report(tmp_path: Path, candidates: int) -> None:
    recording = record(tmp_path / "a.mcap", [*way(3), DeadlinePassed(99)], candidates)
    config = json.dumps({**SEED, "interpreter": {"name": "filter", "options": {"rotations": 1000}}})
    told = replace(recording, metadata={**recording.metadata, "config": {"json": config}})
    report(told, tmp_path / "a.png")
    assert read_png(tmp_path / "a.png").shape == (1200, 1600, 3)
    story = retell(told)
    assert story.has_probabilities
    total = story.series("probability").sum(axis=1) + story.unknown
    np.testing.assert_allclose(total, 1.0, atol=1e-4)


@pytest.mark.parametrize("candidates", [3, 12])
def test_many_candidates_fit(tmp_path: Path, candidates: int) -> None:
    report(record(tmp_path / "a.mcap", way(7), candidates, truth=""), tmp_path / "a.png")
    assert read_png(tmp_path / "a.png").shape == (1200, 1600, 3)


def test_a_recording_without_pictures_or_task_details_has_a_report(tmp_path: Path) -> None:
    recording = record(tmp_path / "a.mcap", [m for m in way(7) if not isinstance(m, Frame)])
    task = {"candidates": recording.metadata["task"]["candidates"]}
    report(replace(recording, metadata={**recording.metadata, "task": task}), tmp_path / "a.png")
    assert read_png(tmp_path / "a.png").shape == (1200, 1600, 3)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Recording]:
    """Short sessions of the simulated rig with a generated product, by preset."""
    from viewsep.assembly import make_engine
    from viewsep.learning import learn_object
    from viewsep.rigs import pace_of, simulated_rig
    from viewsep.session import Session

    sources = {"product": "generated:7", "twin": "generated:7:twin=face"}
    folder = tmp_path_factory.mktemp("simulated")

    def config(preset: str) -> Config:
        return parse_config({"rig": {"preset": preset}, "camera": {"size_px": 64}, "task": {"max_looks": 40}}, "test")

    models = [learn_object(source, name, 24, config("gimbal")) for name, source in sources.items()]

    @cache
    def run(preset: str) -> Recording:
        path = folder / f"{preset}.mcap"
        rig = simulated_rig(config(preset), sources["twin"], 3).rig
        recorder = task_recorder(path, config(preset), models, 3, "twin")
        engine = make_engine(config(preset), models)
        perception = RigPerception(rig, make_descriptor(config(preset).descriptor))
        with recorder, Session(rig, engine, perception, pace_of(config(preset)), [recorder]) as session:
            session.run(3)
        return read_recording(path)

    return run


@pytest.mark.slow
@pytest.mark.needs_pybullet
@pytest.mark.parametrize("preset", ["gimbal", "turntable", "wrist"])
def test_a_simulated_session_has_a_report(tmp_path: Path, simulated: Callable[[str], Recording], preset: str) -> None:
    recording = simulated(preset)
    report(recording, tmp_path / "a.png")
    assert read_png(tmp_path / "a.png").shape == (1200, 1600, 3)


@pytest.mark.needs_pybullet
def test_the_truth_shows_in_the_headline(tmp_path: Path, simulated: Callable[[str], Recording]) -> None:
    recording = simulated("gimbal")
    pictures = []
    for truth in ("twin", "product", ""):
        task = {**recording.metadata["task"], "truth": truth}
        report(replace(recording, metadata={**recording.metadata, "task": task}), tmp_path / "a.png")
        pictures.append(read_png(tmp_path / "a.png"))
    for picture in pictures[1:]:  # all else is the same, pixel for pixel
        differs = np.flatnonzero((picture != pictures[0]).any(axis=(1, 2)))
        assert differs.size
        assert differs.max() < 60


@pytest.mark.needs_pybullet
def test_a_replay_that_decides_otherwise_is_not_passed_off_as_the_recording(
    tmp_path: Path, simulated: Callable[[str], Recording]
) -> None:
    recording = simulated("gimbal")
    kept = tuple(recorded for recorded in recording.messages if recorded.topic != "result")
    report(recording, tmp_path / "a.png")
    report(replace(recording, messages=kept), tmp_path / "b.png")
    note = read_png(tmp_path / "a.png")[55:70, 1100:], read_png(tmp_path / "b.png")[55:70, 1100:]
    assert note[0].min() == 255
    assert note[1].min() < 128
