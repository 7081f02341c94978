"""Photographing an object on the simulated rig, and learning from the photos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shell import Shell

from viewsep.built_rig import SimulatedRig
from viewsep.capture.folder import STATE_NAME, CaptureFolder
from viewsep.capture.lesson import Lesson, learn_from_placements, photograph, shots_of
from viewsep.capture.placements import registered
from viewsep.capture.quality import ENOUGH, photo_quality
from viewsep.capture.run import FEWEST_TRIED, take_photos
from viewsep.config import Config, parse_config
from viewsep.errors import BadInput, Interrupted, RigError
from viewsep.geometry import rotation_angle
from viewsep.interfaces import Look, Perception
from viewsep.learning import learn_view_set
from viewsep.messages import FloatArray, JointState
from viewsep.models.library import load_library
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.rigs import simulated_rig
from viewsep.sim.view_set import Use, read_view_set

pytestmark = pytest.mark.needs_pybullet
PLAN = {"name": "tea", "rig": "turntable"}


def settings(preset: str = "turntable") -> Config:
    return parse_config({"camera": {"size_px": 64}, "rig": {"preset": preset}}, "test")


def holding(config: Config, seed: int = 1, source: str = "generated:7") -> tuple[SimulatedRig, Perception]:
    held = simulated_rig(config, source, seed)
    return held, RigPerception(held.rig, make_descriptor(config.descriptor))


def grasp(config: Config, seed: int) -> FloatArray:
    held, _ = holding(config, seed)
    held.rig.motion.connect()
    rotation = held.true_rotation(held.rig.clock.now_ns())
    held.rig.motion.close()
    return rotation


def lesson(folder: Path, **changes: Any) -> Lesson:
    return replace(Lesson("tea", folder, spacing_deg=40.0), **changes)


# ---- photos ----


def printed(shape: tuple[int, int] = (60, 60)) -> tuple[np.ndarray, np.ndarray]:
    image = np.random.default_rng(1).integers(40, 210, (*shape, 3)).astype(np.uint8)
    mask = np.zeros(shape, bool)
    mask[10:50, 10:50] = True
    return image, mask


def test_a_sharp_and_well_exposed_photo_is_good() -> None:
    quality = photo_quality(*printed())
    assert quality.problem([quality.sharpness] * ENOUGH) == ""


def test_what_is_burnt_out_black_or_blurred_is_not_used() -> None:
    image, mask = printed()
    sharp = photo_quality(image, mask).sharpness
    assert "lower the exposure" in photo_quality(np.minimum(image.astype(int) * 4, 255).astype(np.uint8), mask).problem(
        []
    )
    assert "raise the exposure" in photo_quality(image // 100, mask).problem([])
    smooth = np.full_like(image, 120)
    assert "blurred" in photo_quality(smooth, mask).problem([sharp] * ENOUGH)
    assert photo_quality(smooth, mask).problem([sharp] * (ENOUGH - 1)) == ""  # perhaps there is no print on it


def test_the_sharp_outline_of_a_blurred_object_does_not_make_it_sharp() -> None:
    image, mask = printed()
    image[:] = 250
    image[mask] = 60
    assert photo_quality(image, mask).sharpness < 1.0


# ---- the rig ----


def test_every_planned_view_is_photographed_from_where_it_is_listed(tmp_path: Path) -> None:
    config = settings()
    held, perception = holding(config)
    wanted = lesson(tmp_path / "photos")
    skipped, count = photograph(wanted, held.rig, perception, "here")
    shots = shots_of(wanted, held.rig)
    view_set = read_view_set(wanted.photos)
    assert (skipped, count) == ([], len(shots))
    assert len(view_set.images) == count
    np.testing.assert_allclose(view_set.directions, [shot.direction for shot in shots], atol=0.02)
    assert [bool(trial) for trial in view_set.trial] == [shot.use is Use.TRIAL for shot in shots]
    assert (wanted.photos / "preview.jpg").stat().st_size > 1000
    model = learn_view_set(wanted.photos, "tea", config)
    assert len(model.directions) == sum(shot.use is Use.VIEW for shot in shots)
    assert model.trials is not None
    assert (~model.trials.disturbed).sum() == sum(shot.use is Use.TRIAL for shot in shots) // 2 * 2


def test_what_was_interrupted_is_gone_on_with(tmp_path: Path) -> None:
    config = settings()
    wanted, taken = lesson(tmp_path / "photos"), 0

    def after_five(_problem: str) -> None:
        nonlocal taken
        taken += 1

    def stop(_state: JointState) -> None:
        if taken == 5:
            raise Interrupted("enough")

    held, perception = holding(config)
    with pytest.raises(Interrupted):
        photograph(wanted, held.rig, perception, "here", after_five, stop)
    first = {path.name: path.read_bytes() for path in (wanted.photos / "images").iterdir()}
    assert len(first) == 5
    held, perception = holding(config)
    heard: list[str] = []
    _, count = photograph(wanted, held.rig, perception, "here", heard.append)
    assert len(heard) == count - 5
    assert all((wanted.photos / "images" / name).read_bytes() == data for name, data in first.items())
    with pytest.raises(BadInput, match=r"was begun with rig = 'here', not 'elsewhere'; go on with the same"):
        photograph(wanted, held.rig, perception, "elsewhere")


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(BadInput, match=r"holds other files, and no capture\.json"):
        CaptureFolder(tmp_path, PLAN)
    (tmp_path / STATE_NAME).write_text("{")
    with pytest.raises(BadInput, match=r"capture\.json: cannot be read"):
        CaptureFolder(tmp_path, PLAN)


class Failing:
    """A perception that finds no object in some looks."""

    def __init__(self, perception: Perception, bad: range) -> None:
        self.perception, self.bad, self.looks = perception, bad, 0

    def look(self, newer_than_ns: int, timeout_s: float) -> Look:
        self.looks += 1
        look = self.perception.look(newer_than_ns, timeout_s)
        return replace(look, percept=None, problem="nobody there") if self.looks in self.bad else look


def test_a_bad_look_is_tried_again_and_a_view_without_a_good_one_is_skipped(tmp_path: Path) -> None:
    held, perception = holding(settings())
    failing = Failing(perception, range(2, 6))  # the second view three times, the third once
    skipped, count = photograph(lesson(tmp_path / "photos"), held.rig, failing, "here")
    assert [(one.number, one.problem) for one in skipped] == [(1, "nobody there")]
    assert failing.looks == count + 4


class Dull:
    """A perception that sees no print from some views: as little sharp at every look, or blurred by chance."""

    def __init__(self, perception: Perception, bad: range, *, steady: bool) -> None:
        self.perception, self.bad, self.steady, self.looks = perception, bad, steady, 0

    def look(self, newer_than_ns: int, timeout_s: float) -> Look:
        self.looks += 1
        look = self.perception.look(newer_than_ns, timeout_s)
        if self.looks not in self.bad:
            return look
        assert look.frame is not None
        sigma = 6.0 if self.steady else 2.5 * 2.0 ** (self.looks - self.bad[0])
        return replace(look, frame=replace(look.frame, image=cv2.GaussianBlur(look.frame.image, (0, 0), sigma)))


@pytest.mark.parametrize(("steady", "skipped"), [(True, 0), (False, 1)])
def test_a_side_without_print_is_not_blurred(tmp_path: Path, steady: bool, skipped: int) -> None:
    held, perception = holding(settings())
    dull = Dull(perception, range(7, 10), steady=steady)  # the seventh view, all attempts
    missed, _ = photograph(lesson(tmp_path / "photos"), held.rig, dull, "here")
    assert [one.number for one in missed] == [6][:skipped]
    assert all("blurred" in one.problem for one in missed)


def test_when_most_views_fail_it_stops_and_says_why(tmp_path: Path) -> None:
    held, perception = holding(settings())
    folder = CaptureFolder(tmp_path / "photos", PLAN)
    held.rig.motion.connect()
    held.rig.camera.connect()
    shots = shots_of(lesson(tmp_path), held.rig)
    with pytest.raises(RigError, match=rf"{FEWEST_TRIED} of {FEWEST_TRIED} photos could not be used.*nobody there"):
        take_photos(held.rig, Failing(perception, range(1000)), shots, folder)
    held.rig.motion.close()
    held.rig.camera.close()


@pytest.mark.long
def test_a_second_placement_is_registered_and_merged(tmp_path: Path) -> None:
    config = settings("pan_tilt")
    wanted = lesson(tmp_path / "photos", spacing_deg=30.0)
    for placement in (1, 2):
        held, perception = holding(config, seed=placement)
        photograph(replace(wanted, placement=placement), held.rig, perception, "here")
    alone = learn_view_set(wanted.photos, "tea", config)
    second = read_view_set(replace(wanted, placement=2).photos)
    found = registered(alone, second, config).rotation
    assert np.degrees(rotation_angle(found, grasp(config, 2) @ grasp(config, 1).T)) < 4.0
    model, placements = learn_from_placements(wanted, config)
    assert placements == 2
    assert len(model.directions) > len(alone.directions)
    held, perception = holding(config, source="generated:2")
    photograph(replace(wanted, placement=3), held.rig, perception, "here")
    with pytest.raises(BadInput, match="does not look like tea in its earlier placements"):
        learn_from_placements(wanted, config)


# ---- the command ----


def test_learn_on_the_rig(tmp_path: Path, shell: Shell) -> None:
    config = tmp_path / "rig.toml"
    config.write_text('camera.size_px = 64\nrig.preset = "turntable"\n')
    asked = ["learn", "--rig", "--config", str(config), "--name", "tea", "-o", str(tmp_path / "lib"), "--spacing", "40"]
    said = shell(*asked, "--object", "generated:7", "--json").json
    assert said["name"] == "tea"
    assert said["rig"] == "simulated rig"
    assert said["skipped"] == []
    (model,) = load_library(tmp_path / "lib")
    assert (model.name, len(model.directions), model.digest) == ("tea", said["views"], said["hash"])
    assert said["photos_folder"] == str(tmp_path / "lib" / "tea.photos")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--rig", "--name", "tea"], "--rig needs --object SOURCE"),
        (["--rig", "--object", "generated:7"], "--rig needs --name NAME"),
        (["generated:7", "--rig", "--name", "tea"], "leave out 'generated:7', or leave out --rig"),
        ([], "give at least one SOURCE"),
    ],
)
def test_what_cannot_be_learned_is_said(arguments: list[str], sentence: str, tmp_path: Path, shell: Shell) -> None:
    ended = shell("learn", *arguments, "-o", str(tmp_path))
    assert ended.code == 2
    assert sentence in " ".join(ended.err.split())
