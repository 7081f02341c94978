"""Camera, figure-ground and learning on one rig: cameras by configuration, the empty rig, and tasks without given masks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shell import Shell

from viewsep.cameras import staging_of
from viewsep.config import Config, geometry_of, load_config, parse_config
from viewsep.errors import BadConfig, BadInput
from viewsep.kinematics import preset
from viewsep.perception.empty_rig import MOST, STILL, positions_for
from viewsep.perception.stored import load_background
from viewsep.rigs import PictureKind, SimulatedRig, empty_rig, real_rig, rig_for
from viewsep.sim.world import standing
from viewsep.task import held_object

SERVO = {"joint": "pan", "id": 1, "mode": "extended"}
EMULATED = {"port": "emulated", "servos": [SERVO]}
PLAIN = {"method": "plain"}


def settings(**tables: Any) -> Config:
    return parse_config({"rig": {"preset": "turntable"}, **tables}, "rig.toml")


def real(**tables: Any) -> Config:
    rig = {"preset": "turntable", "backend": "dynamixel"}
    camera = {"source": "v4l2"}
    given = {
        "rig": rig,
        "camera": camera,
        "perception": PLAIN,
        "dynamixel": EMULATED,
        "v4l2": {"device": "/dev/video0"},
    }
    return parse_config({**given, **tables}, "rig.toml")


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
    staged = {"camera": {"source": "staged"}, "perception": PLAIN}
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
    for truth, source in (("tea", None), (None, "generated:7")):
        with pytest.raises(BadInput, match=r"sees what is in the holder: leave '.*' out, and put it there"):
            held_object([], truth, source, real())
    with pytest.raises(BadInput, match="leave 'generated:7' out"):
        rig_for(real(), "generated:7", 0)
    with pytest.raises(BadConfig, match="the camera's device is missing"):
        real_rig(real(v4l2={}))


@pytest.mark.needs_pybullet
def test_a_simulated_camera_has_to_see_something() -> None:
    with pytest.raises(BadInput, match="say what it sees with --object SOURCE"):
        rig_for(settings(), "", 0)
    with pytest.raises(BadConfig, match="there is nothing to capture"):
        empty_rig(settings(), 0)


@pytest.mark.parametrize("name", ["turntable", "pan_tilt", "gimbal", "wrist"])
def test_what_stands_is_upright_on_the_last_joint_at_any_angle(name: str) -> None:
    geometry = preset(name)
    axis = geometry.axes[-1]
    rotations = [standing(geometry, seed) for seed in range(12)]
    for rotation in rotations:
        np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], axis, atol=1e-12)
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
    assert (tilt[0, 0], tilt[-1, 0], np.diff(tilt[:, 0]).max() <= 7.0) == (-60.0, 60.0, True)
    both = np.array(positions_for(geometry.limits, home, [0, 1], float(np.radians(15.0))))
    assert len(both) == 9 * 24 == len(np.unique(both, axis=0))
    assert np.degrees(np.abs(np.diff(both, axis=0)).max()) < 15.1  # to and fro
    with pytest.raises(BadInput, match=rf"tilt and pan show in the picture: .* takes 4920 pictures \(at most {MOST}\)"):
        positions_for(geometry.limits, home, [0, 1], float(np.radians(3.0)))


def write_config(folder: Path, more: str = "") -> Path:
    path = folder / "rig.toml"
    path.write_text(
        'rig.preset = "turntable"\nsim.placed = "standing"\n'
        f'[camera]\nsource = "staged"\nsize_px = 64\n'
        f'[perception]\nmethod = "background"\nbackground = "{folder / "empty.npz"}"\n'
        "[stage]\nwidth_px = 320\nheight_px = 240\nobject_px = 150\n" + more
    )
    return path


@pytest.fixture(scope="module")
def staged(tmp_path_factory: pytest.TempPathFactory, module_shell: Shell) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("staged")
    said = module_shell("rig", "background", "-c", str(write_config(folder)), "--every-deg", "6", "--json").json
    return folder, said
