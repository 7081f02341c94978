"""The driver on a camera that lies about settings, stalls, sends damaged pictures, goes and comes back."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_camera import GAIN, FakeCamera

from viewsep.clock import MonotonicClock
from viewsep.drivers.checks import Verdict
from viewsep.drivers.v4l2 import camera as driver
from viewsep.drivers.v4l2.camera import V4l2Camera
from viewsep.drivers.v4l2.doctor import examine
from viewsep.drivers.v4l2.errors import CameraLost, SettingRefused
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.drivers.v4l2.system import SELECT_TIMEOUT, open_capture
from viewsep.errors import RigError, Timeout

CLOCK = MonotonicClock()
PATIENCE_S = 10.0


@pytest.fixture
def device(tmp_path: Path) -> FakeCamera:
    return FakeCamera(tmp_path)


@pytest.fixture
def make(device: FakeCamera, request: pytest.FixtureRequest) -> Callable[..., V4l2Camera]:
    def made(**others: object) -> V4l2Camera:
        given = {"device": str(device.by_id), "width": 64, "height": 48, "rate_hz": 100, "gain": 7, "stall_s": 0.8}
        camera = V4l2Camera(V4l2Settings(**{**given, **others}), CLOCK, device.system)  # type: ignore[arg-type]
        request.addfinalizer(camera.close)
        return camera

    return made


def newest(camera: V4l2Camera, timeout_s: float = 1.0) -> int:
    """The stamp of a frame of now."""
    return camera.read(CLOCK.now_ns(), timeout_s).stamp_ns


def until(camera: V4l2Camera, kind: type[RigError], said: str) -> None:
    """Read until this is told."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            camera.read(CLOCK.now_ns(), 0.1)
        except kind as error:
            if said in str(error):
                return
        except RigError:
            pass
    raise AssertionError(f"{said!r} was not told")


def until_back(camera: V4l2Camera) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            newest(camera, 0.2)
            return
        except RigError:
            pass
    raise AssertionError("it did not come back")


@pytest.mark.parametrize(
    ("others", "said"),
    [
        (
            {"width": 640, "height": 480},
            "took 128 x 96 instead of 640 x 480: with MJPG choose one of 64 x 48, 128 x 96",
        ),
        ({"rate_hz": 30}, "took 50 pictures per second instead of 30: with MJPG at 64 x 48 choose one of 100, 50"),
        ({"gain": 700}, "takes 0 to 255, not 700"),
    ],
)
def test_a_setting_that_is_taken_with_true_and_not_kept_is_refused(
    make: Callable[..., V4l2Camera], others: dict[str, int], said: str
) -> None:
    with pytest.raises(SettingRefused, match=said):
        make(**others).connect()


def test_a_format_that_it_does_not_have_is_refused(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    device.modes.pop("MJPG")
    with pytest.raises(SettingRefused, match=r"has no format MJPG \(it took YUYV\): choose YUYV"):
        make().connect()
    device.modes = {"GREY": ((64, 48),)}
    with pytest.raises(SettingRefused, match="it has GREY, none of which viewsep reads"):
        make().connect()


def test_padded_lines_are_refused(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    device.line_padding = 64
    with pytest.raises(SettingRefused, match="pads its lines of 64 pixels to 192 bytes"):
        make(format="YUYV").connect()


def test_a_camera_that_is_used_is_not_opened_and_who_has_it_is_told(
    device: FakeCamera, make: Callable[..., V4l2Camera]
) -> None:
    device.busy = True
    (device.folder / "proc/4242/fd").mkdir(parents=True)
    (device.folder / "proc/4242/fd/3").symlink_to(device.node)
    (device.folder / "proc/4242/comm").write_text("cheese\n")
    with pytest.raises(CameraLost, match=r"is used by 4242 \(cheese\): end it"):
        make().connect()
    assert device.opened == []


@pytest.mark.parametrize("offset_s", [-1_700_000_000, 1.0])
def test_stamps_of_another_clock_are_refused_unless_arrival_is_asked_for(
    device: FakeCamera, make: Callable[..., V4l2Camera], offset_s: float
) -> None:
    device.stamp_offset_ns = round(offset_s * 1e9)
    with pytest.raises(CameraLost, match="stamps its frames by another clock"):
        make().connect()
    camera = make(stamps="arrival")
    camera.connect()
    asked_ns = CLOCK.now_ns()
    assert asked_ns < camera.read(asked_ns, 1.0).stamp_ns <= CLOCK.now_ns()
    assert any("stamped when they arrive" in remark for remark in camera.remarks)


def test_a_stamp_ahead_of_the_arrival_becomes_the_arrival(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    device.stamp_offset_ns = 9_000_000
    camera = make()
    camera.connect()
    for _ in range(5):
        assert newest(camera) <= CLOCK.now_ns()


def test_damaged_pictures_are_drops(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    device.spoil = lambda number, data: data[: len(data) // 2] if number % 5 == 2 else data
    camera = make()
    camera.connect()
    frames = [camera.read(CLOCK.now_ns(), 1.0)]
    before = camera.drops
    while len(frames) < 20:
        frames.append(camera.read(frames[-1].stamp_ns, 1.0))
    gaps = np.diff([frame.sequence for frame in frames]) - 1
    assert gaps.sum() >= 3
    assert camera.drops - before == gaps.sum()
    for frame in frames:  # none is the picture of another exposure
        assert frame.image[4, 4].std() < 3


def test_pictures_whose_damage_shows_when_they_are_decoded_are_drops_too(
    device: FakeCamera, make: Callable[..., V4l2Camera]
) -> None:
    device.spoil = lambda number, data: data[: len(data) // 2] + b"\xff\xd9" if number % 5 == 2 else data
    camera = make()
    camera.connect()
    frames = [camera.read(CLOCK.now_ns(), 1.0)]
    before = camera.drops
    while len(frames) < 12:
        frames.append(camera.read(frames[-1].stamp_ns, 1.0))
    gaps = np.diff([frame.sequence for frame in frames]) - 1
    assert gaps.sum() >= 2
    assert camera.drops - before == gaps.sum()


def test_a_camera_that_sends_only_damage_is_told(
    device: FakeCamera, make: Callable[..., V4l2Camera], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewsep.drivers.v4l2.stream.FIRST_S", 0.3)
    device.spoil = lambda number, data: data[:300]
    with pytest.raises(Timeout, match=r"its pictures are damaged \(its end is missing\)"):
        make().connect()


def test_no_old_frame_after_a_pause(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    camera = make()
    camera.connect()
    time.sleep(0.2)
    asked_ns = CLOCK.now_ns()
    assert camera.read(asked_ns, 1.0).stamp_ns > asked_ns


def test_the_fake_has_four_old_frames_after_a_pause_as_the_real_one(device: FakeCamera) -> None:
    capture = device.system.capture(str(device.node), 1)
    capture.grab()
    time.sleep(1.0)
    ages_s = []
    for _ in range(6):
        assert capture.grab()
        ages_s.append(time.monotonic() - capture.get(0) * 1e-3)
    assert min(ages_s[:4]) > 0.5 > max(ages_s[4:])


def test_single_errors_are_survived(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    camera = make()
    camera.connect()
    device.errors = 3
    newest(camera)
    assert len(device.opened) == 1


def test_lasting_errors_open_it_anew(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    camera = make()
    camera.connect()
    device.errors = driver.ERRORS + 1
    until(camera, CameraLost, "gives errors instead of pictures")
    until_back(camera)
    assert len(device.opened) == 2


def test_a_silent_camera_is_told_opened_anew_and_comes_back(
    device: FakeCamera, make: Callable[..., V4l2Camera]
) -> None:
    device.select_s = 0.6
    camera = make()
    camera.connect()
    device.silent = True
    until(camera, Timeout, "within 0.1 s: it has sent nothing for")
    until(camera, CameraLost, "is silent")
    device.silent = False
    until_back(camera)


def test_an_unplugged_camera_is_told_and_not_asked_all_the_time(
    device: FakeCamera, make: Callable[..., V4l2Camera]
) -> None:
    camera = make()
    camera.connect()
    device.unplug()
    until(camera, CameraLost, "is gone")
    grabs = device.grabs
    time.sleep(0.3)
    assert device.grabs - grabs < 5
    until(camera, CameraLost, f"there is no camera {device.by_id}: plug it in")


@pytest.mark.parametrize("by_id", [True, False])
def test_it_comes_back_under_another_number_with_the_same_settings(
    device: FakeCamera, make: Callable[..., V4l2Camera], by_id: bool
) -> None:
    camera = make(device=str(device.by_id if by_id else device.node))
    camera.connect()
    before = camera.read(CLOCK.now_ns(), 1.0)
    device.unplug()
    until(camera, CameraLost, "is gone")
    device.controls[GAIN].value = 55  # it has lost its power
    time.sleep(0.5)
    device.plug(3)
    until_back(camera)
    after = camera.read(CLOCK.now_ns(), 1.0)
    assert device.opened[-1] == str(device.node)
    assert device.node.name == "video3"
    assert device.controls[GAIN].value == 7
    assert after.sequence > before.sequence
    assert camera.drops < 50  # the time without camera is not drops


def test_a_camera_that_comes_back_as_another_one_is_refused(
    device: FakeCamera, make: Callable[..., V4l2Camera]
) -> None:
    camera = make()
    camera.connect()
    device.unplug()
    device.controls.pop(GAIN)
    device.plug(0)
    until(camera, CameraLost, "has no control for gain = 7")


def test_an_unforeseen_error_in_the_thread_reaches_the_reader(
    device: FakeCamera, make: Callable[..., V4l2Camera], monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = make()
    camera.connect()

    def broken(self: object) -> object:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("viewsep.drivers.v4l2.stream.Stream.grab", broken)
    until(camera, CameraLost, "reading the camera")


def test_opencv_is_told_how_long_to_wait(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(SELECT_TIMEOUT, "10")
    capture = open_capture(str(tmp_path / "none"), 2)
    assert not capture.isOpened()
    assert os.environ[SELECT_TIMEOUT] == "2"


def test_the_doctor_finds_a_good_camera_good(device: FakeCamera, make: Callable[..., V4l2Camera]) -> None:
    settings = V4l2Settings(str(device.by_id), "MJPG", 64, 48, 100, exposure_ms=5, white_balance_k=5000, gain=7)
    checks = {check.name: check for check in examine(settings, CLOCK, device.system)}
    assert set(checks) >= {"device", "camera", "alone", "settings", "controls", "stamps", "rate", "drops", "arrival"}
    busy = {"rate", "drops", "arrival"}  # those depend on what else the machine does
    assert {check.verdict for name, check in checks.items() if name not in busy} == {Verdict.GOOD}


def test_the_doctor_says_what_could_be_better(device: FakeCamera) -> None:
    device.lost = lambda number: number % 6 == 5
    device.spoil = lambda number, data: data[:-9] if number % 6 == 4 else data
    settings = V4l2Settings(str(device.node), "MJPG", 64, 48, 100)
    checks = [check for check in examine(settings, CLOCK, device.system) if check.verdict is Verdict.BETTER]
    assert {check.name for check in checks} >= {"name", "drops", "damaged", "left to the camera"}
    assert all(check.remedy for check in checks)


@pytest.mark.parametrize(("what", "check"), [("gone", "device"), ("busy", "opening"), ("silent", "pictures")])
def test_the_doctor_says_what_is_wrong(
    device: FakeCamera, what: str, check: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewsep.drivers.v4l2.stream.FIRST_S", 0.3)
    device.select_s = 0.6
    setattr(device, what, True)
    *_, last = examine(V4l2Settings(str(device.by_id), "MJPG", 64, 48, 100), CLOCK, device.system)
    assert (last.name, last.verdict) == (check, Verdict.BAD)
    assert last.remedy
