"""What the kernel is asked, byte for byte, and what is made of its answers."""

from __future__ import annotations

import errno
import os
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from fake_camera import GAIN, FakeCamera, FakeControl

from viewsep.drivers.v4l2 import node as asked
from viewsep.drivers.v4l2.controls import set_fixed, verify
from viewsep.drivers.v4l2.errors import CameraLost, SettingRefused
from viewsep.drivers.v4l2.listing import cameras, holders, stable_name
from viewsep.drivers.v4l2.node import Node, Structure, why_not
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.errors import BadConfig

HEADER = {  # as a C compiler prints them from linux/videodev2.h on x86-64
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "G_FMT": 0xC0D05604,
    "REQBUFS": 0xC0145608,
    "G_PARM": 0xC0CC5615,
    "G_CTRL": 0xC008561B,
    "S_CTRL": 0xC008561C,
    "QUERYCTRL": 0xC0445624,
    "ENUM_FRAMESIZES": 0xC02C564A,
    "ENUM_FRAMEINTERVALS": 0xC034564B,
}


@pytest.fixture
def camera(tmp_path: Path) -> FakeCamera:
    return FakeCamera(tmp_path)


def settings(camera: FakeCamera, **others: object) -> V4l2Settings:
    return V4l2Settings(str(camera.by_id), **others)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", HEADER)
def test_requests_are_those_of_the_header(name: str) -> None:
    structure: Structure = getattr(asked, name)
    assert structure.request == HEADER[name]
    assert structure.layout.size == structure.request >> 16 & 0x3FFF


def test_what_a_camera_is_and_can(camera: FakeCamera) -> None:
    with Node(camera.by_id, camera.system) as node:
        assert (node.capability().card, node.capability().driver) == ("Fake Camera", "uvcvideo")
        assert node.capability().captures
        assert node.formats() == ("MJPG", "YUYV")
        assert [(mode.format, mode.width, mode.height, mode.rates_hz) for mode in node.modes()] == [
            ("MJPG", 64, 48, (100.0, 50.0)),
            ("MJPG", 128, 96, (100.0, 50.0)),
            ("YUYV", 64, 48, (100.0, 50.0)),
        ]
        assert [control.name for control in node.controls()][:2] == ["White Balance, Automatic", "Gain, Automatic"]
        assert node.rate_hz() == 100.0


def test_a_driver_whose_lists_never_end_is_not_followed_for_ever(camera: FakeCamera) -> None:
    camera.rates_hz = tuple(range(10_000, 0, -1))
    camera.modes = {"YUYV": ((64, 48),)}
    with Node(camera.by_id, camera.system) as node:
        (mode,) = node.modes()
    assert len(mode.rates_hz) == asked.MOST


def test_ranges_of_sizes_and_rates_give_their_ends(camera: FakeCamera) -> None:
    def answer(file: int, request: int, data: bytearray) -> None:
        if request == asked.ENUM_FRAMESIZES.request:
            struct.pack_into("=I6I", data, 8, 3, 32, 1920, 8, 16, 1080, 8)
        elif request == asked.ENUM_FRAMEINTERVALS.request:
            struct.pack_into("=I6I", data, 16, 3, 1, 60, 1, 1, 0, 0)
        else:
            camera.system.ioctl(file, request, data)

    system = replace(camera.system, ioctl=answer)
    camera.modes = {"YUYV": ()}
    with Node(camera.by_id, system) as node:
        assert [(m.width, m.height, m.rates_hz) for m in node.modes()] == [
            (32, 16, (60.0, 1.0)),
            (1920, 1080, (60.0, 1.0)),
        ]


def test_cameras_are_listed_by_the_name_that_stays(camera: FakeCamera) -> None:
    (found,) = cameras(camera.system)
    assert (found.name, found.node, found.card) == (str(camera.by_id), str(camera.node), "Fake Camera")
    assert stable_name(str(camera.node), camera.system) == str(camera.by_id)
    camera.by_id.unlink()
    assert stable_name(str(camera.node), camera.system) == str(camera.node)
    by_path = camera.folder / "dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0"
    by_path.symlink_to(camera.node)
    assert cameras(camera.system)[0].name == str(by_path)


def test_a_camera_that_cannot_be_asked_is_listed_with_the_reason(camera: FakeCamera) -> None:
    camera.gone = True
    (found,) = cameras(camera.system)
    assert found.card == "Fake Camera: Fake Camera"
    assert "is no camera" in found.problem


def test_other_processes_that_have_it_are_named(camera: FakeCamera) -> None:
    for number, target in (("4242", camera.node), ("4243", camera.folder), (str(os.getpid()), camera.node)):
        (camera.folder / "proc" / number / "fd").mkdir(parents=True)
        (camera.folder / "proc" / number / "fd" / "7").symlink_to(target)
        (camera.folder / "proc" / number / "comm").write_text("cheese\n")
    assert holders(str(camera.by_id), camera.system) == ("4242 (cheese)",)


@pytest.mark.parametrize(
    ("number", "remedy"),
    [(errno.ENOENT, "plug it in"), (errno.EACCES, "usermod -aG video"), (errno.EIO, "Input/output error")],
)
def test_why_a_node_cannot_be_opened(number: int, remedy: str) -> None:
    assert remedy in why_not("/dev/video0", OSError(number, os.strerror(number)))


def test_controls_are_set_to_manual_first_and_read_back(camera: FakeCamera) -> None:
    wanted = settings(camera, exposure_ms=20.0, white_balance_k=5000, gain=7)
    with Node(camera.by_id, camera.system) as node:
        assert set_fixed(node, wanted) == ()
        verify(node, wanted)
        values = {control.name: control.value for control in camera.controls.values()}
        assert values == {
            "White Balance, Automatic": 0,
            "Gain, Automatic": 0,
            "Gain": 7,
            "White Balance Temperature": 5000,
            "Auto Exposure": 1,
            "Exposure Time, Absolute": 200,
        }
        camera.controls[GAIN].value = 8  # somebody else
        with pytest.raises(SettingRefused, match=r"'Gain'.* is 8 instead of 7"):
            verify(node, wanted)


def test_what_is_not_set_is_said(camera: FakeCamera) -> None:
    camera.controls[0x00980912].value = 0
    with Node(camera.by_id, camera.system) as node:
        remarks = set_fixed(node, settings(camera))
    assert len(remarks) == 3  # it has no focus
    assert any("exposure_ms is not set: the camera changes" in remark for remark in remarks)
    assert "gain is not set: 'Gain' stays at 100 until somebody changes it" in remarks


@pytest.mark.parametrize(
    ("others", "changed", "said"),
    [
        ({"focus": 3}, {}, "no control for focus = 3"),
        ({"gain": 300}, {}, r"'Gain'.* takes 0 to 255, not 300: correct gain"),
        ({"exposure_ms": 300.0}, {}, r"takes 3 to 2047, not 3000: correct exposure_ms \(a unit is 0.1 ms\)"),
        ({"gain": 7}, {"takes": lambda value: 6}, "is 6 instead of 7"),
        ({"gain": 7}, {"takes": lambda value: None}, r"refused 7 \(Input/output error\)"),
        ({"gain": 7}, {"flags": asked.READ_ONLY}, "cannot be set: leave gain out"),
    ],
)
def test_a_control_that_is_refused_or_clamped_is_an_error(
    camera: FakeCamera, others: dict[str, float], changed: dict[str, object], said: str
) -> None:
    camera.controls[GAIN] = FakeControl("Gain", 0, 255, 100, **changed)  # type: ignore[arg-type]
    with Node(camera.by_id, camera.system) as node, pytest.raises(SettingRefused, match=said) as error:
        set_fixed(node, settings(camera, **others))
    assert str(camera.by_id) in str(error.value)
    assert (camera.controls[0x0098090C].value, camera.controls[0x009A0901].value) == (1, 3)  # nothing else was set


def test_a_closed_or_foreign_node_is_no_camera(camera: FakeCamera, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with Node(tmp_path / "file", camera.system) as node, pytest.raises(CameraLost, match="is no camera"):
        node.capability()
    with pytest.raises(CameraLost, match=r"there is no camera .*video9"):
        Node(camera.folder / "dev/video9", camera.system)


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ({"device": ""}, "device is missing"),
        ({"format": "H264"}, "choose MJPG or YUYV"),
        ({"stamps": "mine"}, "choose kernel or arrival"),
        ({"width": 0}, "width = 0"),
        ({"format": "YUYV", "width": 641}, "has to be even"),
        ({"exposure_ms": 0.01}, "exposure_ms = 0.01"),
        ({"stall_s": 0.0}, "stall_s = 0"),
    ],
)
def test_settings_that_no_camera_can_have(others: dict[str, object], said: str) -> None:
    with pytest.raises(BadConfig, match=said):
        V4l2Settings(**{"device": "/dev/video0", **others}).check()  # type: ignore[arg-type]
