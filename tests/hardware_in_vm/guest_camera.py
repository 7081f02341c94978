"""In the machine: the camera driver on Linux' own test camera (vivid), with errors injected and the camera taken away.

Seen with OpenCV 4.14 on Linux 6.1, and what the driver relies on or works around:

* A format that the camera does not have (MJPG) is "set" and True; it reads back as the one before.
* Once somebody has buffers, REQBUFS with none tells EBUSY; a second `VideoCapture` does not open, and gives no reason.
* After a pause the next four frames are those that waited in the queue; then comes one of now.
* Stamps are of CLOCK_MONOTONIC. By default vivid stamps the end of the frame, 0.9 periods ahead of its delivery.
* A buffer with the flag of an error is delivered as any other: `grab` is True, and OpenCV does not tell.
* Where no buffer comes `grab` returns False after the select timeout, which is 1 s at the least.
* After a fatal error of the stream, and when the camera is gone, `grab` returns False at once and for ever.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from steps import expect, step, wait_until

from viewsep.clock import MonotonicClock
from viewsep.drivers.checks import Verdict
from viewsep.drivers.v4l2.camera import V4l2Camera
from viewsep.drivers.v4l2.doctor import examine
from viewsep.drivers.v4l2.errors import CameraLost, SettingRefused
from viewsep.drivers.v4l2.listing import cameras
from viewsep.drivers.v4l2.node import Node
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.drivers.v4l2.system import open_capture
from viewsep.errors import RigError, Timeout
from viewsep.messages import Frame

BY_PATH = Path("/dev/v4l/by-path/platform-vivid.0-video-index0")
VIVID = Path("/sys/bus/platform/drivers/vivid")
CONTROLS = 0x00F0_F000  # vivid's own
STAMP_SOURCE, DROPPED, DISCONNECT, FLAGGED, FATAL = (CONTROLS + number for number in (24, 64, 65, 66, 70))
GAIN, AUTOGAIN = 0x0098_0913, 0x0098_0912
RATE_HZ = 15
PERIOD_NS = round(1e9 / RATE_HZ)
FRAME_S = 3.0
TOLD_S = 5.0
BACK_S = 10.0
PAUSE_S = 1.5
CLOCK = MonotonicClock()


def link() -> str:
    """The camera's name by path, laid as udev would. Raises TimeoutError."""

    def node() -> str | None:
        return next((found.node for found in cameras() if found.driver == "vivid"), None)

    found = wait_until("a camera of vivid", BACK_S, node)
    BY_PATH.parent.mkdir(parents=True, exist_ok=True)
    BY_PATH.unlink(missing_ok=True)
    BY_PATH.symlink_to(found)
    return str(BY_PATH)


def settings(**others: object) -> V4l2Settings:
    """What vivid has at this rate."""
    given: dict[str, object] = {"device": str(BY_PATH), "format": "YUYV", "width": 320, "height": 180}
    return V4l2Settings(**{**given, "rate_hz": RATE_HZ, **others})  # type: ignore[arg-type]


def connect(**others: object) -> None:
    """Connect, and close again. Raises RigError."""
    with camera(**others):
        pass


@contextmanager
def camera(**others: object) -> Iterator[V4l2Camera]:
    """Connected, and closed in the end."""
    made = V4l2Camera(settings(**others), CLOCK)
    made.connect()
    try:
        yield made
    finally:
        made.close()


def check_opencv() -> None:
    """What the driver has to work around."""
    with step("vivid gives a camera among nodes that give no pictures") as note:
        link()
        found = [one for one in cameras() if one.driver == "vivid"]
        expect(len(found) == 1, f"{len(found)} nodes give pictures")
        expect(found[0].by_path == str(BY_PATH), f"its name is {found[0].name}")
        yuyv = [f"{m.width}x{m.height}@{m.rates_hz[0]:g}" for m in found[0].modes if m.format == "YUYV"]
        note(f"{found[0].node}, card {found[0].card!r}, YUYV {' '.join(yuyv)}, Linux {os.uname().release}")
    with step("OpenCV: a refused format is True, the queue is old after a pause, stamps are monotonic") as note:
        capture = open_capture(str(BY_PATH), 1)
        refused = capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode()
        note(f"set MJPG → {refused}, reads back as {code}")
        expect(refused and code != "MJPG", "a format that it does not have was refused, or taken")
        try:
            note(opencv_stamps(capture))
            second = open_capture(str(BY_PATH), 1)
            note(f"a second opener: isOpened → {second.isOpened()}")
            with Node(BY_PATH) as node:
                node.set_value(FLAGGED, 1)
            grabbed = [capture.grab() for _ in range(5)]
            note(f"the next buffer is flagged as damaged: grab → {grabbed}")
            expect(all(grabbed), "OpenCV tells of flagged buffers now: count them as damaged")
        finally:
            capture.release()


def opencv_stamps(capture: object) -> str:
    """Ages of frames, before and after a pause in which nobody takes any."""

    def age_ms() -> float:
        assert isinstance(capture, cv2.VideoCapture)
        expect(capture.grab(), "no frame came")
        age = time.monotonic_ns() * 1e-6 - capture.get(cv2.CAP_PROP_POS_MSEC)
        capture.retrieve()  # until then OpenCV holds one of the four buffers back
        return age

    before = [age_ms() for _ in range(4)]
    time.sleep(PAUSE_S)
    after = [age_ms() for _ in range(6)]
    expect(max(map(abs, before)) < 500.0 * PAUSE_S, f"stamps are not of the monotonic clock: {before} ms")
    expect(min(after[:4]) > 500.0 * PAUSE_S > max(after[4:]), f"not four old frames: {after}")
    ages = [" ".join(f"{age:.0f}" for age in part) for part in (before, after)]
    return f"ages in ms: {ages[0]} | {PAUSE_S:g} s pause | {ages[1]}"


def check_settings() -> None:
    """What the camera does not take is an error that says so."""
    with step("settings that the camera does not take are refused") as note:
        for others in ({"format": "MJPG"}, {"width": 322}, {"rate_hz": 24}, {"focus": 5}, {"gain": 999}):
            note(f"{others} → {refusal(partial(connect, **others))}")
        note(f"another node → {refusal(partial(connect, device=other_node()))}")
        note(f"no node → {refusal(partial(connect, device='/dev/video77'))}")
    with step("gain is set to manual, and read back") as note:
        with Node(BY_PATH) as node:
            before = node.value(AUTOGAIN), node.value(GAIN)
            with camera(gain=77) as opened:
                note(f"automatic {before[0]}, gain {before[1]} → {node.value(AUTOGAIN)}, {node.value(GAIN)}")
                expect((node.value(AUTOGAIN), node.value(GAIN)) == (0, 77), "it is not what was asked for")
                note(f"remarks: {opened.remarks}")
            node.set_value(AUTOGAIN, 1)
        with camera() as opened:
            note(f"left alone: {opened.remarks}")
            expect(any("by itself" in remark for remark in opened.remarks), "nobody says that it changes by itself")


def check_frames() -> None:
    """Stamps, sequence, drops, pauses, errors."""
    with camera(gain=77) as opened, Node(BY_PATH) as node:
        with step("frames carry stamps and numbers, and no old one comes after a pause") as note:
            node.set_value(STAMP_SOURCE, 1)  # of the beginning of the exposure
            first = opened.read(CLOCK.now_ns(), FRAME_S)
            before = opened.drops
            frames = [first, *successive(opened, 12, first.stamp_ns)]
            gaps = np.diff([frame.stamp_ns for frame in frames]) * 1e-6
            note(
                f"{frames[0].image.shape}, every {gaps.min():.0f} to {gaps.max():.0f} ms, {opened.drops - before} drops"
            )
            lost = sum(np.diff([frame.sequence for frame in frames]) - 1)
            expect(opened.drops - before == lost, f"{opened.drops - before} drops, but {lost} numbers are missing")
            expect(float(frames[0].image.std()) > 10.0, "the picture is plain")
            time.sleep(1.0)
            asked_ns = CLOCK.now_ns()
            frame = opened.read(asked_ns, FRAME_S)
            note(f"after a pause the next is {(frame.stamp_ns - asked_ns) * 1e-6:.0f} ms younger than the question")
            expect(frame.stamp_ns > asked_ns, "it is older")
        with step("a second opener is told who has the camera") as note:
            note(refusal(connect))
        with step("dropped frames are counted") as note:
            before = opened.drops
            node.set_value(DROPPED, 40)
            frames = successive(opened, 20)
            node.set_value(DROPPED, 0)
            gaps = np.diff([frame.sequence for frame in frames]) - 1
            note(f"{opened.drops - before} drops among {frames[-1].sequence - frames[0].sequence + 1} exposures")
            expect(gaps.sum() > 0, "no gap in the sequence")
        with step("a camera that falls silent is told, opened anew, and delivers when it can") as note:
            node.set_value(DROPPED, 100)
            note(f"→ {told(opened, Timeout)}")
            note(f"→ {told(opened, CameraLost)}")
            node.set_value(DROPPED, 0)
            note(f"back after {back(opened):.1f} s")
        with step("after a fatal error of the stream it is opened anew") as note:
            node.set_value(FATAL, 1)
            note(f"→ {told(opened, CameraLost)}")
            note(f"back after {back(opened):.1f} s")


def check_unplugged() -> None:
    """Taken away, and put back under another number."""
    with camera(gain=77) as opened:
        with step("a camera that is disconnected is told, and comes back") as note:
            with Node(BY_PATH) as node:
                node.set_value(DISCONNECT, 1)  # vivid connects again as soon as nobody has it open
            note(f"→ {told(opened, CameraLost)}")
            note(f"back after {back(opened):.1f} s")
        with step("its driver is unbound and bound: it comes back under another number, set up as before") as note:
            before = BY_PATH.resolve()
            held = os.open(before, os.O_RDWR)  # so that the number stays taken
            (VIVID / "unbind").write_text("vivid.0")
            BY_PATH.unlink()
            note(f"→ {told(opened, CameraLost)}")
            used_s, began_s = time.process_time(), time.monotonic()
            time.sleep(1.0)
            busy = (time.process_time() - used_s) / (time.monotonic() - began_s)
            note(f"{busy:.0%} of the processor while it is away")
            expect(busy < 0.5, "it spins")
            (VIVID / "bind").write_text("vivid.0")
            after = Path(link()).resolve()
            note(f"{before} → {after}")
            expect(before != after, "it has the number that is still held")
            note(f"back after {back(opened):.1f} s, {opened.drops} drops")
            with Node(BY_PATH) as node:
                expect((node.value(AUTOGAIN), node.value(GAIN)) == (0, 77), "the new one is not set up")
            with suppress(OSError):
                os.close(held)


def check_doctor() -> None:
    """The doctor's verdicts on it, with its stamps at the beginning of the exposure, as webcams have them."""
    with step("the doctor looks it over, and tells who else has it open") as note, Node(BY_PATH) as node:
        node.set_value(STAMP_SOURCE, 1)
        with BY_PATH.open("rb") as file:
            other = subprocess.Popen(["sleep", "60"], stdin=file)
        try:
            checks = list(examine(settings(gain=77), CLOCK))
        finally:
            other.kill()
            other.wait()
        for check in checks:
            note(f"{check.verdict}: {check.name}: {check.found} {check.remedy and '→ ' + check.remedy}")
            expect(check.verdict != Verdict.BAD, f"{check.name} fails")
        found = {check.name: check.found for check in checks}
        expect(f"{other.pid} (sleep)" in found["alone"], "it does not tell who else has it open")
        expect("after the stamp" in found["arrival"], "stamps of the beginning are not before the arrival")


def successive(opened: V4l2Camera, count: int, newer_than_ns: int = 0) -> list[Frame]:
    """Every frame that arrives from then on, or from now."""
    frames = [opened.read(newer_than_ns or CLOCK.now_ns(), FRAME_S)]
    while len(frames) < count:
        frames.append(opened.read(frames[-1].stamp_ns, FRAME_S))
    return frames


def told(opened: V4l2Camera, kind: type[RigError]) -> str:
    """The error of this kind that reading raises before long. Raises TimeoutError."""

    def error() -> str | None:
        try:
            opened.read(CLOCK.now_ns(), 0.5)
        except kind as error:
            return f"{type(error).__name__}: {error}"
        except RigError:
            return None
        return None

    return wait_until(f"a {kind.__name__}", TOLD_S, error)


def back(opened: V4l2Camera) -> float:
    """How long it takes until frames come again. Raises TimeoutError."""
    began_s = time.monotonic()

    def frame() -> bool:
        with suppress(RigError):
            opened.read(CLOCK.now_ns(), 0.5)
            return True
        return False

    wait_until("frames", BACK_S, frame)
    return time.monotonic() - began_s


def other_node() -> str:
    """A node of vivid that gives no pictures."""
    return next(str(node) for node in sorted(Path("/dev").glob("video*")) if node != BY_PATH.resolve())


def refusal(call: Callable[[], object]) -> str:
    """What a call says that has to be refused."""
    try:
        call()
    except (CameraLost, SettingRefused) as error:
        return f"{type(error).__name__}: {error}"
    raise AssertionError("it was not refused")


if __name__ == "__main__":
    check_opencv()
    check_settings()
    check_frames()
    check_unplugged()
    check_doctor()
