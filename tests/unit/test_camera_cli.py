"""`viewsep camera` on a camera that is not there."""

from __future__ import annotations

import json
import os
import signal
import threading
from pathlib import Path

import cv2
import pytest
from fake_camera import GAIN, FakeCamera
from shell import Shell

OPTIONS = ("--size", "64x48", "--rate-hz", "100")


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCamera:
    camera = FakeCamera(tmp_path / "machine")
    for module in ("camera_options", "camera_list", "camera_doctor"):
        monkeypatch.setattr(f"viewsep.cli.{module}.THIS_MACHINE", camera.system)
    return camera


def test_cameras_are_listed(shell: Shell, device: FakeCamera) -> None:
    listed = shell("camera", "list")
    assert listed.code == 0
    assert "Fake Camera" in listed.out
    assert "128x96: 100, 50" in listed.out
    (found,) = shell("camera", "list", "--json").json
    assert (found["camera"], found["by_path"], found["driver"]) == (str(device.by_id), None, "uvcvideo")
    assert found["modes"][0] == {"format": "MJPG", "width": 64, "height": 48, "rates_hz": [100.0, 50.0]}


def test_without_a_camera_the_list_says_so(shell: Shell, device: FakeCamera) -> None:
    device.unplug()
    listed = shell("camera", "list")
    assert (listed.code, listed.err) == (1, "no camera: plug one in\n")
    assert shell("camera", "list", "--json").json == []
    doctor = shell("camera", "doctor")
    assert doctor.code == 2
    assert "there is no camera: plug one in" in doctor.err


def test_the_doctor_looks_the_only_camera_over(shell: Shell, device: FakeCamera) -> None:
    looked = shell("camera", "doctor", *OPTIONS, "--json")
    assert looked.code == 0, looked.out
    names = {check["check"] for check in looked.json}
    assert names >= {"device", "settings", "left to the camera", "stamps", "rate", "drops", "arrival"}
    assert shell("camera", "doctor", *OPTIONS).code == 0
    device.busy = True
    looked = shell("camera", "doctor", *OPTIONS, "--json")
    assert looked.code == 1
    assert looked.json[-1]["verdict"] == "fail"


def test_the_settings_of_the_configuration_are_made(shell: Shell, device: FakeCamera, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    given = f'device = "{device.by_id}"\nwidth_px = 128\nheight_px = 96\nrate_hz = 50\ngain = 9\n'
    config.write_text(f"[v4l2]\n{given}")
    taken = shell("camera", "snapshot", "--config", config, "-o", tmp_path / "a.png", "--json")
    assert (taken.code, taken.json["width"], taken.json["height"]) == (0, 128, 96)
    assert not any("gain" in remark for remark in taken.json["remarks"])
    assert device.controls[GAIN].value == 9
    config.write_text(f"[v4l2]\n{given}gain_db = 3\n")
    refused = shell("camera", "snapshot", "--config", config, "-o", tmp_path / "b.png")
    assert refused.code == 2
    assert "v4l2.gain_db" in refused.err


@pytest.mark.parametrize("name", ["tea.png", "tea.jpg"])
def test_a_snapshot_is_a_picture_of_now(name: str, shell: Shell, device: FakeCamera, tmp_path: Path) -> None:
    file = tmp_path / name
    taken = shell("camera", "snapshot", "--device", device.by_id, *OPTIONS, "-o", file)
    assert taken.code == 0, taken.err
    assert f"wrote {file}" in taken.err
    picture = cv2.imread(str(file))
    assert picture is not None
    assert picture.shape == (48, 64, 3)
    again = shell("camera", "snapshot", "--device", device.by_id, *OPTIONS, "-o", file)
    assert (again.code, "--force" in again.err) == (2, True)
    assert shell("camera", "snapshot", "--device", device.by_id, *OPTIONS, "-o", file, "--force").code == 0
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [name]


@pytest.mark.parametrize(
    ("typed", "said", "code"),
    [
        (("--size", "64*48"), "write WIDTHxHEIGHT", 2),
        (("-o", "tea.gif"), "end its name with .png", 2),
        (("--device", "/dev/video77"), "there is no camera /dev/video77", 1),
        (("--size", "640x480"), "took 128 x 96 instead of 640 x 480", 1),
        (("--size", "0x48"), "width = 0", 2),
        (("--format", "YUYV", "--size", "65x48"), "has to be even", 2),
    ],
)
def test_mistakes_are_one_sentence(
    typed: tuple[str, ...], said: str, code: int, shell: Shell, device: FakeCamera, tmp_path: Path
) -> None:
    ended = shell("camera", "snapshot", "-o", tmp_path / "tea.png", *OPTIONS, *typed)
    assert ended.code == code
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "tea.png").exists()


def test_two_cameras_need_a_choice(shell: Shell, device: FakeCamera, tmp_path: Path) -> None:
    (device.folder / "dev/video4").touch()
    entry = device.folder / "sys/video4"
    entry.mkdir()
    (entry / "name").write_text("Another")
    ended = shell("camera", "snapshot", "-o", tmp_path / "tea.png")
    assert ended.code == 2
    assert "there are 2 cameras: give one with --device: " in ended.err
    assert str(device.by_id) in ended.err


def test_focus_shows_how_sharp_the_picture_is(shell: Shell, device: FakeCamera) -> None:
    shown = shell("camera", "focus", *OPTIONS, "--count", 4, "--json")
    assert shown.code == 0, shown.err
    lines = [json.loads(line) for line in shown.out.splitlines()]
    assert len(lines) == 4
    assert all(0 < line["sharpness"] <= line["best"] for line in lines)
    assert [line["best"] for line in lines] == sorted(line["best"] for line in lines)
    shown = shell("camera", "focus", *OPTIONS, "--count", 2)
    assert shown.out.count("█") > 10
    assert "the best was" in shown.err


def test_ctrl_c_ends_it_and_gives_the_camera_back(shell: Shell, device: FakeCamera) -> None:
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    shown = shell("camera", "focus", *OPTIONS)
    timer.join()
    assert shown.code == 130
    assert "the best was" in shown.err
    assert "viewsep camera device" not in [thread.name for thread in threading.enumerate()]
