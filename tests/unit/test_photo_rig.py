"""The rig over photos shows each photo from where it was taken, whatever else goes wrong, and only those it may."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from seed_method import seed_config
from view_sets import Angles, ring, write_view_set

from viewsep.assembly import make_engine, reachable_views
from viewsep.built_rig import PictureKind, SimulatedRig
from viewsep.config import Config, RigConfig, SimConfig, geometry_of, parse_config
from viewsep.errors import BadConfig, BadInput
from viewsep.geometry import angle_between, rotation_angle, spherical_direction
from viewsep.learning import learn_view_set
from viewsep.messages import Frame, JointState, Message, Percept, PerceptReceived
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.photo_rig import held_out, photo_rig
from viewsep.plugins import make_descriptor
from viewsep.rigs import pace_of, rig_holding
from viewsep.session import Session
from viewsep.sim.view_set import ViewSet, read_view_set

RING = ring(*range(0, 360, 10))
HOLES = ring(*(azimuth for azimuth in range(0, 360, 10) if azimuth not in (50, 200, 210)), elevation_deg=25.0)
DOME = [(float(a), float(e)) for e in (0, 20, 40) for a in range(0, 360, 20)]
MAX_LOOKS = 30


@dataclass
class Heard:
    """What crossed the loop: percepts with the frame they were made of, and the read-backs."""

    frames: list[Frame] = field(default_factory=list)
    seen: list[tuple[Frame, Percept]] = field(default_factory=list)
    states: list[JointState] = field(default_factory=list)

    def hear(self, _stamp_ns: int, message: Message) -> None:
        if isinstance(message, Frame):
            self.frames.append(message)
        elif isinstance(message, PerceptReceived):
            self.seen.append((self.frames[-1], message.percept))
        elif isinstance(message, JointState):
            self.states.append(message)


def config(**disturbances: float) -> Config:
    return seed_config(task={"max_looks": MAX_LOOKS, "look_every_deg": 0}, sim=disturbances)


def sets(folder: Path, angles_deg: list[Angles]) -> list[ViewSet]:
    return [read_view_set(write_view_set(folder / f"tin_{k}", k, angles_deg)) for k in (1, 2)]


def run(rig: SimulatedRig, models: list[AspectGraph], seed: int = 0) -> Heard:
    heard, used = Heard(), rig.config
    perception = RigPerception(rig.rig, make_descriptor(used.descriptor))
    session = Session(rig.rig, make_engine(used, models), perception, pace_of(used), [heard])
    with session:
        session.run(seed)
    return heard


def models_of(view_sets: list[ViewSet], every: int) -> list[AspectGraph]:
    return [learn_view_set(v.folder, v.name, seed_config(), every=every) for v in view_sets]


@pytest.mark.parametrize("angles_deg", [RING, HOLES, DOME], ids=["ring", "holes", "dome"])
@pytest.mark.parametrize("disturbances", [{}, {"latency_s": 0.15, "drop_rate": 0.2}], ids=["plain", "late and lossy"])
def test_every_percept_of_a_run_pairs_a_photo_with_its_own_direction(
    tmp_path: Path, angles_deg: list[Angles], disturbances: dict[str, float]
) -> None:
    view_sets = sets(tmp_path, angles_deg)
    models = models_of(view_sets, 3)
    rig = rig_holding(str(view_sets[0].folder), models, config(**disturbances), 4)
    heard = run(rig, models)
    photos = {view_sets[0].picture(k, 128)[0].tobytes(): k for k in range(len(angles_deg))}
    assert len(photos) == len(angles_deg)
    shown = set()
    moving = 0
    assert len(heard.seen) >= MAX_LOOKS
    for frame, percept in heard.seen:
        index = photos[frame.image.tobytes()]
        true = rig.true_rotation(frame.stamp_ns) @ view_sets[0].directions[index]
        assert np.degrees(float(angle_between(percept.view_direction, true))) < 0.1
        shown.add(index)
        moving += next(state.moving for state in heard.states if state.stamp_ns >= frame.stamp_ns)
    assert len(shown) >= 5
    assert moving >= 5  # exposed on the way from one view to the next
    assert shown.isdisjoint(range(0, len(angles_deg), 3))


def test_pictures_and_encoders_are_disturbed_as_on_any_simulated_rig(tmp_path: Path) -> None:
    view_sets = sets(tmp_path, RING)
    models = models_of(view_sets, 3)
    clean = run(rig_holding(str(view_sets[0].folder), models, config(), 4), models)
    noisy_config = config(light=0.3, noise=0.05, blur_px=1.0, mask_error=0.1, encoder_noise_deg=1.0)
    noisy = run(rig_holding(str(view_sets[0].folder), models, noisy_config, 4), models)
    (plain, _), (wrong, percept) = clean.seen[0], noisy.seen[0]
    assert (plain.image != wrong.image).mean() > 0.5
    assert plain.mask is not None
    assert wrong.mask is not None
    assert 0 < (plain.mask != wrong.mask).sum() < 0.3 * plain.mask.sum()
    turned = [float(angle_between(percept.view_direction, p.view_direction)) for _, p in clean.seen]
    assert min(turned) > np.radians(0.1)


def test_the_same_seed_gives_the_same_course_and_another_one_another_angle(tmp_path: Path) -> None:
    view_sets = sets(tmp_path, RING)
    models = models_of(view_sets, 3)
    rigs = [rig_holding(str(view_sets[0].folder), models, config(), seed) for seed in (4, 4, 5)]
    assert rotation_angle(rigs[0].true_rotation(0), rigs[1].true_rotation(0)) == 0.0
    assert rotation_angle(rigs[0].true_rotation(0), rigs[2].true_rotation(0)) > 0.1
    one, two = run(rigs[0], models), run(rigs[1], models)
    assert one.states == two.states
    assert [f.image.tobytes() for f in one.frames] == [f.image.tobytes() for f in two.frames]


def test_the_object_stands_upright_at_an_angle_that_the_seed_decides(tmp_path: Path) -> None:
    (view_set, _) = sets(tmp_path, RING)
    rotation = photo_rig(Config(), view_set, range(36), 8).true_rotation(0)
    turn = np.random.default_rng([8, 1]).uniform(0.0, 2.0 * np.pi)
    expected = [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(rotation, expected, atol=1e-12)


def test_one_elevation_makes_a_turntable_and_several_tilt_and_pan(tmp_path: Path) -> None:
    flat = photo_rig(Config(), sets(tmp_path / "a", HOLES)[0], range(20), 1)
    assert [limit.name for limit in flat.rig.geometry.limits] == ["pan"]
    assert flat.config.rig.camera_elevation_deg == 25.0
    dome = photo_rig(Config(), sets(tmp_path / "b", DOME)[0], range(20), 1)
    assert [limit.name for limit in dome.rig.geometry.limits] == ["tilt", "pan"]
    np.testing.assert_allclose(dome.rig.geometry.limits[0].upper_rad, np.radians(20.0))


@pytest.mark.parametrize("angles_deg", [HOLES, DOME], ids=["ring", "dome"])
def test_the_configuration_that_comes_with_it_names_all_its_views_and_no_other(
    tmp_path: Path, angles_deg: list[Angles]
) -> None:
    view_set = sets(tmp_path, angles_deg)[0]
    rig = photo_rig(Config(), view_set, range(1, 30, 2), 3)
    again = parse_config(rig.config.model_dump(mode="json"), "a recording")
    assert again == rig.config
    reachable = reachable_views(again.rig)
    expected = view_set.directions[1:30:2] @ rig.true_rotation(0).T
    np.testing.assert_allclose(reachable.directions, expected, atol=1e-9)
    geometry = geometry_of(again.rig)
    for view in reachable.directions:
        assert reachable.reaches(view)
        joints = geometry.joints_for(view, [0.0] * len(geometry.limits))
        assert np.degrees(float(angle_between(geometry.view_direction(joints), view))) < 0.05
    assert not reachable.reaches(view_set.directions[2] @ rig.true_rotation(0).T)


def test_a_candidate_shows_the_photos_its_model_was_not_learned_from(tmp_path: Path) -> None:
    view_sets = sets(tmp_path, RING)
    folder = str(view_sets[0].folder)
    every_fourth, every = models_of(view_sets, 4), models_of(view_sets, 1)
    assert held_out(view_sets[0], every_fourth) == [k for k in range(36) if k % 4]
    rig = rig_holding(folder, every_fourth, Config(), 0)
    assert (len(rig.config.rig.views_deg), rig.pictures) == (27, PictureKind.PHOTOS)
    assert rig.object_digest == every_fourth[0].provenance.source_digest
    rig = rig_holding(folder, every, Config(), 0)
    assert (len(rig.config.rig.views_deg), rig.pictures) == (36, PictureKind.LEARNED_PHOTOS)
    rig = rig_holding(folder, every_fourth[1:], Config(), 0)
    assert (len(rig.config.rig.views_deg), rig.pictures) == (36, PictureKind.PHOTOS)


def test_too_few_photos_are_refused(tmp_path: Path) -> None:
    view_set = sets(tmp_path, RING)[0]
    with pytest.raises(BadInput, match=r"tin_1: 2 photos are too few for a rig \(at least 3\); leave more of them out"):
        photo_rig(Config(), view_set, [0, 1], 0)


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        ({"preset": "wrist"}, "key 'rig.preset' is set, but the rig over the photos in .*tin_1 follows from"),
        ({"preset": "turntable", "camera_elevation_deg": 30}, "key 'rig.camera_elevation_deg' is set, but"),
        ({"joints": [{"name": "pan", "axis": [0, 0, 1]}]}, "key 'rig.joints' is set, but .*: remove the key"),
        ({"backend": "photos", "views_deg": [[0, 0]]}, "key 'rig.views_deg' is set, but"),
    ],
)
def test_a_rig_set_up_otherwise_is_refused(tmp_path: Path, rig: dict[str, Any], words: str) -> None:
    view_set = sets(tmp_path, RING)[0]
    with pytest.raises(BadConfig, match=words):
        photo_rig(Config(rig=RigConfig.model_validate(rig)), view_set, range(36), 0)


def test_a_rig_set_up_the_same_way_is_fine(tmp_path: Path) -> None:
    view_set = sets(tmp_path, RING)[0]
    rig = RigConfig(backend="photos", preset="turntable", camera_elevation_deg=20.0)
    set_up, filled_in = (photo_rig(given, view_set, range(36), 0) for given in (Config(rig=rig), Config()))
    assert set_up.config == filled_in.config


@pytest.mark.parametrize("key", ["backlash_deg", "slip_deg"])
def test_what_photos_cannot_show_is_refused(tmp_path: Path, key: str) -> None:
    view_set = sets(tmp_path, RING)[0]
    with pytest.raises(BadConfig, match=f"key 'sim.{key}' = 2: photos have no such disturbance"):
        photo_rig(Config(sim=SimConfig.model_validate({key: 2.0})), view_set, range(36), 0)


def test_a_damaged_photo_is_found_before_anything_moves(tmp_path: Path) -> None:
    view_set = sets(tmp_path, RING)[0]
    (view_set.folder / "v007.png").write_bytes(b"")
    with pytest.raises(BadInput, match=r"v007.png: is not a picture"):
        photo_rig(Config(), view_set, range(36), 0)
    assert len(photo_rig(Config(), view_set, range(8, 36), 0).config.rig.views_deg) == 28


def test_views_go_with_photos_and_photos_with_views() -> None:
    with pytest.raises(BadConfig, match=r"key 'rig.views_deg' goes with rig.backend = 'photos', not 'sim': remove it"):
        parse_config({"rig": {"views_deg": [[0, 0]]}}, "c.toml")
    with pytest.raises(BadConfig, match=r"c.toml: key 'rig.views_deg.0.1' = 91"):
        parse_config({"rig": {"backend": "photos", "views_deg": [[0, 91]]}}, "c.toml")
    with pytest.raises(BadConfig, match=r"rig.backend = 'photos', but no view set is held: name a folder of photos"):
        reachable_views(RigConfig(backend="photos"))


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(0.0, 20.0), (33.0, -50.0), (250.0, 90.0)])
def test_the_joints_that_show_a_view_follow_from_its_angles(
    tmp_path: Path, azimuth_deg: float, elevation_deg: float
) -> None:
    angles = [(azimuth_deg, elevation_deg), (100.0, 0.0), (200.0, 0.0)]
    rig = photo_rig(Config(), read_view_set(write_view_set(tmp_path / "tin", 1, angles)), range(3), 2)
    azimuth, elevation = np.radians(rig.config.rig.views_deg[0])
    joints = (elevation, -azimuth)
    np.testing.assert_allclose(
        rig.rig.geometry.view_direction(joints),
        rig.true_rotation(0) @ spherical_direction(*np.radians((azimuth_deg, elevation_deg))),
        atol=1e-9,
    )
    rig.rig.motion.connect()
    rig.rig.motion.move_to(joints)
    rig.rig.clock.sleep_until(20_000_000_000)
    np.testing.assert_allclose(rig.rig.motion.read_state().position_rad, joints, atol=2e-3)
    rig.rig.motion.close()
