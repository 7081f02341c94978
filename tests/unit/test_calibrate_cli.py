"""The commands that calibrate a rig: what they find, print and store."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from shell import Shell
from test_board import BOARD, drawn, star

from viewsep.bench.compensation import Calibrated, late_rig, summed
from viewsep.calibration.board import sight
from viewsep.calibration.latency import Interval, Timing, agreed
from viewsep.config import Config, RigConfig, load_config
from viewsep.kinematics import preset
from viewsep.messages import Outcome

ELEVATION_DEG = 40.0
FOV = ("--fov-deg", "30")


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the board on a turntable, seen by a camera 40 degrees above it."""
    folder = tmp_path_factory.mktemp("board")
    angles = [0.0, 50.0, 100.0, -60.0, -110.0]
    rows = [["image", "pan"]]
    for number, position in enumerate(star(preset("turntable"), angles)):
        name = f"{number}.png"
        cv2.imwrite(str(folder / name), drawn(preset("turntable", ELEVATION_DEG), position, number))
        rows.append([name, f"{np.degrees(position[0]):g}"])
    with (folder / "angles.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return folder


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text('[rig]\npreset = "turntable"  # mine\n')
    return path


def test_the_board_tells_how_high_the_camera_is(shell: Shell, pictures: Path, config: Path) -> None:
    ended = shell("rig", "calibrate", "board", pictures, "--config", config, *FOV, "--json")
    assert ended.code == 0, ended.err
    assert ended.json["camera_elevation_deg"] == pytest.approx(ELEVATION_DEG, abs=0.2)
    assert ended.json["pictures"] == 5
    assert [joint["joint"] for joint in ended.json["joints"]] == ["pan"]
    assert load_config(config).rig.camera_elevation_deg == pytest.approx(ELEVATION_DEG, abs=0.2)
    assert "# mine" in config.read_text()
    assert config.with_name("rig.toml.bak").read_text() == '[rig]\npreset = "turntable"  # mine\n'


def test_axes_are_stored_where_joints_are_written_out(shell: Shell, pictures: Path, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('[[rig.joints]]\nname = "pan"\naxis = [0.3, 0.0, 1.0]\n')
    ended = shell("rig", "calibrate", "board", pictures, "--config", path, *FOV)
    assert ended.code == 0, ended.err
    assert "camera elevation 40." in ended.out or "camera elevation 39.9" in ended.out
    (joint,) = load_config(path).rig.joints
    assert joint.axis == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


def test_with_keep_nothing_is_stored(shell: Shell, pictures: Path, config: Path) -> None:
    before = config.read_bytes()
    assert shell("rig", "calibrate", "board", pictures, "--config", config, *FOV, "--keep").code == 0
    assert config.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,tilt\n0.png,0\n", "line 1: must name the columns image,pan"),
        ("image,pan\n0.png,north\n", "line 2: could not convert string to float: 'north'"),
        ("image,pan\n0.png,inf\n", "line 2: joint angles must be finite"),
        ("image,pan\n0.png,0,0\n", "line 2: has 3 cells"),
        ("image,pan\nnone.png,0\n", "line 2: 'none.png'"),
        ("image,pan\n", "lists no pictures"),
        ("image,pan\n0.png,0\n", "the board is seen in 1 pictures, at least 4 are needed"),
    ],
)
def test_lists_that_cannot_be_used_are_refused(
    text: str, said: str, shell: Shell, pictures: Path, config: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "some"
    folder.mkdir()
    (folder / "angles.csv").write_text(text)
    (folder / "0.png").write_bytes((pictures / "0.png").read_bytes())
    ended = shell("rig", "calibrate", "board", folder, "--config", config)
    assert ended.code == 2
    assert said in ended.err
    assert not config.with_name("rig.toml.bak").exists()


def test_a_joint_that_turns_the_other_way_is_not_stored(
    shell: Shell, pictures: Path, config: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "back"
    folder.mkdir()
    for path in pictures.glob("*.png"):
        (folder / path.name).write_bytes(path.read_bytes())
    rows = list(csv.reader((pictures / "angles.csv").read_text().splitlines()))
    lines = [",".join(rows[0]), *(f"{image},{-float(angle):g}" for image, angle in rows[1:])]
    (folder / "angles.csv").write_text("\n".join(lines))
    ended = shell("rig", "calibrate", "board", folder, "--config", config, *FOV)
    assert ended.code == 2
    assert "joint 'pan' turns the other way" in ended.err
    assert not config.with_name("rig.toml.bak").exists()


@pytest.mark.parametrize("kind", ["png", "pdf"])
def test_the_board_is_written_to_be_printed(kind: str, shell: Shell, tmp_path: Path) -> None:
    first, second = tmp_path / f"board.{kind}", tmp_path / f"again.{kind}"
    assert shell("rig", "board", "--out", first).code == 0
    ended = shell("rig", "board", "--out", second)
    assert "150 x 110 mm" in ended.err
    assert first.read_bytes() == second.read_bytes()
    if kind == "png":
        seen = sight(BOARD, np.asarray(cv2.imread(str(first))), (0.0,))
        assert seen is not None
        assert len(seen.pixel) == 24


def test_boards_that_cannot_be_are_refused(shell: Shell, tmp_path: Path) -> None:
    ended = shell("rig", "board", "--out", tmp_path / "board.gif")
    assert (ended.code, ".png or .pdf" in ended.err) == (2, True)
    ended = shell("rig", "board", "--out", tmp_path / "board.png", "--columns", "20", "--rows", "20")
    assert (ended.code, "50 markers at the most" in ended.err) == (2, True)


@pytest.mark.needs_pybullet
def test_the_camera_command_finds_play_and_stores_it(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[rig]\npreset = "turntable"\n[camera]\nsize_px = 64\n[sim]\nbacklash_deg = 1.5\n')
    ended = shell("rig", "calibrate", "camera", "--config", path, "--json")
    assert ended.code == 0, ended.err
    (joint,) = ended.json["joints"]
    assert joint["joint"] == "pan"
    assert joint["backlash_deg"]["value"] == pytest.approx(1.5, abs=0.3)
    assert ended.json["latency_s"]["value"] == pytest.approx(0.0, abs=0.005)
    stored = load_config(path)
    assert stored.rig.backlash_deg == pytest.approx((joint["backlash_deg"]["value"],), abs=0.001)
    assert stored.camera.latency_s == pytest.approx(ended.json["latency_s"]["value"], abs=1e-4)


@pytest.mark.needs_pybullet
@pytest.mark.long
def test_the_object_is_looked_at_and_not_the_desk(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(
        '[rig]\npreset = "turntable"\n[camera]\nsource = "staged"\n[sim]\nplaced = "standing"\nbacklash_deg = 1.5\n'
        f'[perception]\nmethod = "background"\nbackground = "{tmp_path / "empty.npz"}"\nobject_radius_px = 70\n'
        "[stage]\nwidth_px = 320\nheight_px = 240\nobject_px = 150\n"
    )
    assert shell("rig", "background", "-c", file, "--every-deg", 20).code == 0
    found = shell("rig", "calibrate", "camera", "--config", file, "--json").json
    play = found["joints"][0]["backlash_deg"]
    assert abs(play["value"] - 1.5) < play["margin"] + 0.05
    assert play["margin"] < 0.5  # of the whole picture it was more than 2 degrees
    assert load_config(file).rig.backlash_deg == pytest.approx([play["value"]], abs=1e-3)


def test_calibrate_alone_is_that_of_the_joints(shell: Shell, config: Path) -> None:
    for words in (("calibrate",), ("calibrate", "joints")):
        ended = shell("rig", *words, "--config", config)
        assert ended.code == 2
        assert "rig.backend = 'sim' has no servos" in ended.err
    assert "viewsep rig calibrate camera" in shell("rig", "calibrate", "--help").out


def test_values_that_agree_are_surer_and_those_that_do_not_are_less() -> None:
    together = agreed([Interval(0.08, 0.002), Interval(0.081, 0.002)])
    assert together.value == pytest.approx(0.0805)
    assert together.margin < 0.002
    apart = agreed([Interval(0.08, 0.001), Interval(0.12, 0.01)])
    assert apart.value < 0.081
    assert apart.margin > 0.03


def test_found_values_go_into_the_configuration() -> None:
    one = Timing(Interval(0.08, 0.001), Interval(np.radians(2.0), 0.001), 0.001, 100, 3)
    found = Calibrated(one.latency_s, (one, one)).in_config(Config(rig=RigConfig(preset="pan_tilt")))
    assert found.rig.backlash_deg == pytest.approx((2.0, 2.0))
    assert found.camera.latency_s == 0.08


def test_outcomes_are_counted() -> None:
    ended = [
        (Outcome.IDENTIFIED, True, 0.1),
        (Outcome.IDENTIFIED, False, 2.0),
        (Outcome.UNDECIDED, False, 1.0),
        (Outcome.IDENTIFIED, True, 0.2),
    ]
    counted = summed(ended)
    assert (counted.right, counted.wrong, counted.open, counted.pose_errors_rad) == (2, 1, 1, (0.1, 0.2))


@pytest.mark.needs_pybullet
def test_an_injected_latency_makes_stamps_late() -> None:
    simulated = late_rig(Config(rig=RigConfig(preset="turntable")), "generated:7", 0, 0.1, 1.0)
    rig = simulated.rig
    rig.motion.connect()
    rig.camera.connect()
    try:
        frame = rig.camera.read(rig.clock.now_ns() + 500_000_000, 2.0)
        assert frame.stamp_ns - rig.clock.now_ns() == pytest.approx(0.1e9, abs=5e6), (
            "the physics goes on to its next step"
        )
    finally:
        rig.camera.close()
        rig.motion.close()
    assert simulated.scene.disturbances.backlash_deg == 1.0
