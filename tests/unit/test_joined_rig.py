"""Cameras by configuration, the empty rig captured, and learning and separation without any given mask."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_camera import FakeCamera
from shell import Shell

from viewsep.bench.chain import Chain, chain_config, run_chain
from viewsep.bench.tasks import draw_tasks
from viewsep.built_rig import PictureKind, SimulatedRig
from viewsep.cameras import staging_of
from viewsep.config import Config, geometry_of, parse_config
from viewsep.errors import BadConfig, BadInput, try_all
from viewsep.geometry import rotation_showing
from viewsep.kinematics import preset
from viewsep.moves import move_and_wait
from viewsep.perception import RigPerception
from viewsep.perception.empty_rig import MOST, STILL, positions_for
from viewsep.perception.setup import finder_of
from viewsep.perception.stored import load_background, load_holder
from viewsep.plugins import make_descriptor
from viewsep.rigs import empty_rig, real_rig, rig_for
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer
from viewsep.sim.view_set import read_view_set
from viewsep.sim.world import standing
from viewsep.task import held_object

SERVO = {"joint": "pan", "id": 1, "mode": "extended"}
EMULATED = {"port": "emulated", "servos": [SERVO]}
PLAIN = {"method": "plain"}
SMALL_STAGE = {"width_px": 320, "height_px": 240, "object_px": 150}
BOX, TWIN = "generated:7", "generated:7:twin=face"


def settings(**tables: Any) -> Config:
    return parse_config({"rig": {"preset": "turntable"}, **tables}, "rig.toml")


def real(**tables: Any) -> Config:
    rig = {"preset": "turntable", "backend": "dynamixel"}
    given = {"rig": rig, "camera": {"source": "v4l2"}, "perception": PLAIN, "dynamixel": EMULATED}
    return parse_config({**given, "v4l2": {"device": "/dev/video0"}, **tables}, "rig.toml")


# ---- configuration ----


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"camera": {"source": "staged"}}, r"no mask comes with its pictures, but perception\.method = 'given'"),
        ({"camera": {"source": "v4l2"}}, r"no mask comes with its pictures, but perception\.method = 'given'"),
        ({"camera": {"source": "v4l2"}, "perception": PLAIN}, r"set rig\.backend = 'dynamixel'"),
        (
            {"camera": {"source": "staged"}, "perception": PLAIN, "rig": {"backend": "photos"}},
            r"a rig over photos shows those",
        ),
        (
            {"camera": {"source": "staged"}, "perception": PLAIN, "sim": {"mask_error": 0.1}},
            r"key 'sim\.mask_error' = 0\.1 goes with camera\.source = 'simulated'.*in \[stage\]",
        ),
        ({"camera": {"source": "webcam"}}, r"key 'camera\.source' = 'webcam'"),
        ({"stage": {"shadow": 2.0}}, r"key 'stage\.shadow' = 2\.0"),
        ({"sim": {"placed": "lying"}}, r"key 'sim\.placed' = 'lying'"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(tables: dict[str, Any], sentence: str) -> None:
    with pytest.raises(BadConfig, match=r"^rig\.toml: .*" + sentence):
        settings(**tables)


def test_a_real_camera_knows_no_other_time() -> None:
    assert real().camera.source == "v4l2"
    with pytest.raises(BadConfig, match=r"emulated_speed' = 5: a real camera knows no other time"):
        real(dynamixel=EMULATED | {"emulated_speed": 5.0})


def test_a_turntable_has_a_plate_and_others_have_none() -> None:
    staged: dict[str, Any] = {"camera": {"source": "staged"}, "perception": PLAIN}
    assert staging_of(settings(**staged), 3).plate
    assert not staging_of(settings(**staged, rig={"preset": "pan_tilt"}), 3).plate
    staging = staging_of(settings(**staged, stage={"plate": False, "seed": 4, "width_px": 320}), 3)
    assert (staging.plate, staging.seed, staging.size, staging.occasion) == (False, 4, (320, 480), (3,))


# ---- rigs ----


def test_a_real_camera_sees_what_is_in_the_holder() -> None:
    built = rig_for(real(), "", 0)
    assert (built.pictures, built.speed, isinstance(built, SimulatedRig)) == (PictureKind.CAMERA, 1.0, False)
    assert built.described == "emulated servos, camera /dev/video0"
    assert held_object([], None, None, real()) == ("", "")
    for truth, source in (("tea", None), (None, BOX)):
        with pytest.raises(BadInput, match=r"sees what is in the holder: leave '.*' out, and put it there"):
            held_object([], truth, source, real())
    with pytest.raises(BadInput, match=f"leave '{BOX}' out"):
        rig_for(real(), BOX, 0)
    with pytest.raises(BadConfig, match="the camera's device is missing"):
        real_rig(real(v4l2={}))


def test_a_real_camera_beside_servos_makes_percepts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = FakeCamera(tmp_path)
    monkeypatch.setattr("viewsep.cameras.THIS_MACHINE", device.system)
    region = {"method": "region", "region": [8, 8, 40, 30]}
    v4l2 = {"device": str(device.by_id), "width_px": 64, "height_px": 48, "rate_hz": 100}
    config = real(v4l2=v4l2, perception=region, camera={"source": "v4l2", "size_px": 32})
    rig = rig_for(config, "", 0).rig
    rig.motion.connect()
    try:
        rig.camera.connect()
        perception = RigPerception(rig, make_descriptor(config.descriptor), finder_of(config))
        move_and_wait(rig.motion, rig.clock, [0.3])
        look = perception.look(rig.clock.now_ns(), 2.0)  # stamps of frame and read-backs are of one clock
        assert look.percept is not None, look.problem
        expected = rig.geometry.view_direction(rig.motion.read_state().position_rad)
        np.testing.assert_allclose(look.percept.view_direction, expected, atol=1e-3)
        assert look.frame is not None
        assert look.frame.image.shape == (32, 32, 3)
    finally:
        try_all((rig.motion.close, rig.camera.close))


@pytest.mark.needs_pybullet
def test_a_simulated_camera_has_to_see_something() -> None:
    with pytest.raises(BadInput, match="say what it sees with --object SOURCE"):
        rig_for(settings(), "", 0)
    with pytest.raises(BadConfig, match="there is nothing to capture"):
        empty_rig(settings(), 0)


@pytest.mark.parametrize("name", ["turntable", "pan_tilt", "gimbal", "wrist"])
def test_what_stands_is_upright_on_the_last_joint_at_any_angle(name: str) -> None:
    geometry = preset(name)
    rotations = [standing(geometry, seed) for seed in range(12)]
    for rotation in rotations:
        np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], geometry.axes[-1], atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    headings = np.sort([np.arctan2(*(rotation @ [1.0, 0.0, 0.0])[:2]) for rotation in rotations])
    assert np.ptp(headings) > np.pi
    assert np.diff(headings).min() > 1e-6


# ---- the empty rig ----


def test_the_empty_rig_is_captured_where_something_shows() -> None:
    geometry = geometry_of(settings(rig={"preset": "pan_tilt"}).rig)
    home = geometry.home()
    assert positions_for(geometry.limits, home, [], 0.1) == [home] * STILL
    pan = positions_for(geometry.limits, home, [1], float(np.radians(3.0)))
    np.testing.assert_allclose(np.degrees(pan), [[0.0, 3.0 * k] for k in range(120)], atol=1e-9)
    tilt = np.degrees(positions_for(geometry.limits, home, [0], float(np.radians(7.0))))
    assert (tilt[0, 0], tilt[-1, 0]) == pytest.approx((-60.0, 60.0))
    assert np.diff(tilt[:, 0]).max() <= 7.0
    both = np.array(positions_for(geometry.limits, home, [0, 1], float(np.radians(15.0))))
    assert len(both) == 9 * 24 == len(np.unique(both, axis=0))
    assert np.degrees(np.abs(np.diff(both, axis=0)).max()) < 15.1  # to and fro
    with pytest.raises(BadInput, match=rf"tilt and pan show in the picture: .* takes 4920 pictures \(at most {MOST}\)"):
        positions_for(geometry.limits, home, [0, 1], float(np.radians(3.0)))


def rig_file(folder: Path, name: str, more: str = "") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(
        f'[rig]\npreset = "{name}"\n[camera]\nsource = "staged"\nsize_px = 64\n[sim]\nplaced = "standing"\n'
        f'[perception]\nmethod = "background"\nbackground = "{folder / "empty.npz"}"\nobject_radius_px = 70\n'
        f"[stage]\nwidth_px = 320\nheight_px = 240\nobject_px = 150\n{more}"
    )
    return path


@pytest.mark.needs_pybullet
def test_rig_background_writes_what_is_behind_the_object(tmp_path: Path, shell: Shell) -> None:
    typed: list[str | Path] = [
        "rig",
        "background",
        "-c",
        rig_file(tmp_path, "turntable"),
        "--every-deg",
        "30",
        "--json",
    ]
    said = shell(*typed).json
    assert (said["pictures"], said["joints"], said["rig"]) == (12, ["pan"], "simulated rig, staged camera")
    assert said["background"] == str(tmp_path / "empty.npz")
    model = load_background(tmp_path / "empty.npz")
    assert model.moving is not None
    np.testing.assert_allclose(np.degrees(model.angles.joints[:, 0]), np.arange(0.0, 360.0, 30.0), atol=0.5)
    before = (tmp_path / "empty.npz").read_bytes()
    ended = shell(*typed)
    assert ended.code == 2
    assert "exists: choose another name, or --force" in " ".join(ended.err.split())
    assert shell(*typed, "--force").code == 0
    assert (tmp_path / "empty.npz").read_bytes() == before  # the same rig and seed


@pytest.mark.needs_pybullet
def test_joints_that_do_not_show_are_found_out(tmp_path: Path, shell: Shell) -> None:
    said = shell("rig", "background", "-c", rig_file(tmp_path, "pan_tilt"), "--json").json
    assert (said["pictures"], said["joints"]) == (STILL, [])
    model = load_background(tmp_path / "empty.npz")
    assert model.moving is None
    gripped = rig_file(tmp_path, "pan_tilt", "gripper = true\nshake_px = 0.9\n")
    said = shell("rig", "background", "-c", gripped, "--every-deg", "45", "--force", "--json").json
    assert (said["pictures"], said["joints"]) == (8, ["pan"])  # the stage's gripper does not tilt
    angles = load_background(tmp_path / "empty.npz").angles
    near, beyond = angles.nearest([0.5, np.radians(46.0)])  # so it is all the same how far it is tilted
    assert beyond == 0.0
    assert np.degrees(angles.joints[near[0], 1]) == pytest.approx(45.0, abs=0.5)


@pytest.mark.needs_pybullet
def test_a_holder_before_a_backdrop_is_captured_by_its_masks(tmp_path: Path, shell: Shell) -> None:
    config = rig_file(tmp_path, "turntable", 'background = "plain"\nplate = false\ngripper = true\n')
    typed: list[str | Path] = ["--holder", tmp_path / "holder.npz", "--joints", "pan", "--every-deg", "45"]
    assert shell("rig", "background", "-c", config, *typed, "--json").json["background"] is None
    holder = load_holder(tmp_path / "holder.npz")
    assert holder.masks.shape == (8, 240, 320)
    assert 0.01 < holder.masks.mean() < 0.3


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (["--joints", "tilt"], "--joints 'tilt': the rig has pan"),
        (["-o", "empty.png"], "end its name with .npz"),
    ],
)
def test_what_cannot_be_captured_is_said(typed: list[str], sentence: str, tmp_path: Path, shell: Shell) -> None:
    ended = shell("rig", "background", "-c", rig_file(tmp_path, "turntable"), *typed)
    assert ended.code == 2
    assert sentence in " ".join(ended.err.split())


# ---- the chain ----


def small_chain(folder: Path) -> Chain:
    changes = {
        "camera": {"source": "staged", "size_px": 64},
        "stage": SMALL_STAGE,
        "interpreter": {"name": "filter", "options": {"rotations": 4000}},
    }
    config = chain_config("turntable", folder / "empty.npz", 1.0, changes, servos=False)
    perception = config.perception.model_copy(update={"object_radius_px": 70.0})
    config = config.model_copy(update={"perception": perception})
    return Chain(config, folder, seed=1, placements=1, spacing_deg=20.0, trials=0.5, every_deg=10.0)


@pytest.mark.needs_pybullet
def test_an_object_is_learned_before_a_background_that_was_captured(tmp_path: Path) -> None:
    chain = replace(small_chain(tmp_path), spacing_deg=45.0, every_deg=20.0)
    assert chain.capture_empty() == 18
    learned = chain.learn(BOX, "tea")
    assert learned.skipped == 0
    assert len(learned.model.directions) == 8
    view_set = read_view_set(tmp_path / "tea.photos" / "placement_1")
    assert len(view_set.images) == learned.photos
    renderer = open_renderer(BOX, CameraOptics(64))
    for index, direction in enumerate(view_set.directions):
        seen_from = learned.rotation.T @ direction
        _, alone = renderer.render(np.array([1.0, 0.0, 0.0]), rotation_showing(seen_from, np.array([1.0, 0.0, 0.0])))
        assert view_set.load(index)[1].mean() == pytest.approx(alone.mean(), rel=0.25)
    renderer.close()


@pytest.mark.long
@pytest.mark.needs_pybullet
def test_objects_are_learned_and_told_apart_without_any_given_mask(tmp_path: Path) -> None:
    tasks = draw_tasks([(BOX, TWIN)], [BOX, TWIN], 2, seed=5)
    heard: list[None] = []
    run = run_chain(small_chain(tmp_path), tasks, lambda: heard.append(None))
    assert len(heard) == 4
    assert run.empty_pictures == 36
    assert [one.model.name for one in run.learned] == ["product_7", "product_7_twin_face"]
    assert all(len(one.model.directions) >= 16 and one.skipped <= 2 for one in run.learned)
    for row in run.rows:
        assert row["verdict"] == "right", row
        assert row["pose_error_deg"] < 45.0  # views of a ring, 20 degrees apart, leave the tilt open


def test_the_bench_names_a_rig_that_it_does_not_have(shell: Shell) -> None:
    ended = shell("bench", "chain", "--rigs", "turntable,crane")
    assert ended.code == 2
    assert "--rigs 'crane': choose from turntable, pan_tilt" in " ".join(ended.err.split())
