"""A camera as OpenCV and the kernel show it, without either: what was seen of OpenCV 4.14 on Linux' test camera.

`FakeCamera` stands behind two seams: the calls of `cv2.VideoCapture`, and ioctls with the kernel's structures in bytes.
"""

from __future__ import annotations

import errno
import itertools
import os
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from viewsep.drivers.v4l2.system import System
from viewsep.messages import Array

QUEUE = 4
GAIN, AUTOGAIN, EXPOSURE_AUTO, EXPOSURE = 0x00980913, 0x00980912, 0x009A0901, 0x009A0902
AUTO_WHITE_BALANCE, WHITE_BALANCE = 0x0098090C, 0x0098091A


@dataclass
class FakeControl:
    """`takes` is what the driver makes of a value that it is given; None refuses it."""

    name: str
    minimum: int
    maximum: int
    value: int
    step: int = 1
    flags: int = 0
    takes: Callable[[int], int | None] = lambda value: value


def usual_controls() -> dict[int, FakeControl]:
    return {
        AUTO_WHITE_BALANCE: FakeControl("White Balance, Automatic", 0, 1, 1),
        AUTOGAIN: FakeControl("Gain, Automatic", 0, 1, 1),
        GAIN: FakeControl("Gain", 0, 255, 100),
        WHITE_BALANCE: FakeControl("White Balance Temperature", 2800, 6500, 4600, step=10),
        EXPOSURE_AUTO: FakeControl("Auto Exposure", 0, 3, 3),
        EXPOSURE: FakeControl("Exposure Time, Absolute", 3, 2047, 250),
    }


@dataclass
class FakeCamera:
    """A camera that exposes at `rate_hz` from the moment it is set going, on the machine's monotonic clock.

    `lost` are numbers of exposures that never come, `spoil` changes the bytes of one. `stamp_offset_ns` is what the
    stamps are off by. `silent`, `gone`, `busy` and `errors` (that many grabs fail at once) can change meanwhile.
    """

    folder: Path
    rate_hz: float = 100.0
    modes: dict[str, tuple[tuple[int, int], ...]] = field(
        default_factory=lambda: {"MJPG": ((64, 48), (128, 96)), "YUYV": ((64, 48),)}
    )
    rates_hz: tuple[int, ...] = (100, 50)
    lost: Callable[[int], bool] = lambda number: False
    spoil: Callable[[int, bytes], bytes] = lambda number, data: data
    stamp_offset_ns: int = 0
    controls: dict[int, FakeControl] = field(default_factory=usual_controls)
    select_s: float = 0.3
    silent: bool = False
    gone: bool = False
    busy: bool = False
    errors: int = 0
    line_padding: int = 0
    number: int = 0
    grabs: int = 0
    plugs: int = 0
    opened: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("dev/v4l/by-id", "dev/v4l/by-path", "sys", "proc"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.plug(self.number)

    @property
    def system(self) -> System:
        dev, sysfs, proc = (self.folder / name for name in ("dev", "sys", "proc"))
        return System(dev, sysfs, proc, self._open, self._ioctl)

    @property
    def node(self) -> Path:
        return self.folder / f"dev/video{self.number}"

    @property
    def by_id(self) -> Path:
        return self.folder / "dev/v4l/by-id/usb-Fake_Camera_0001-video-index0"

    def plug(self, number: int) -> None:
        """As the kernel and udev do, under this number."""
        self.number, self.gone, self.plugs = number, False, self.plugs + 1
        self.node.touch()
        entry = self.folder / f"sys/video{number}"
        entry.mkdir()
        (entry / "name").write_text("Fake Camera: Fake Camera\n")
        self.by_id.symlink_to(self.node)

    def unplug(self) -> None:
        self.gone = True
        self.by_id.unlink()
        self.node.unlink()
        (self.folder / f"sys/video{self.number}/name").unlink()
        (self.folder / f"sys/video{self.number}").rmdir()

    def _open(self, path: str, timeout_s: int) -> FakeCapture:
        self.opened.append(path)
        return FakeCapture(self, self.node == Path(path) and not self.gone)

    def _ioctl(self, file: int, request: int, data: bytearray) -> None:
        number, size = request & 0xFF, request >> 16 & 0x3FFF
        assert len(data) == size
        if self.gone or Path(f"/proc/self/fd/{file}").readlink() != self.node:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        answer = {0: self._querycap, 2: self._enum_fmt, 4: self._g_fmt, 8: self._reqbufs, 21: self._g_parm}
        answer |= {27: self._g_ctrl, 28: self._s_ctrl, 36: self._queryctrl, 74: self._sizes, 75: self._intervals}
        answer[number](data)

    def _querycap(self, data: bytearray) -> None:
        flags = 0x85200001
        struct.pack_into("=16s32s32sIII", data, 0, b"uvcvideo", b"Fake Camera", b"usb-1", 0x60100, flags, 0x04200001)

    def _enum_fmt(self, data: bytearray) -> None:
        index = struct.unpack_from("=I", data)[0]
        name = known(list(self.modes), index)
        struct.pack_into("=II32s4s", data, 4, 1, 0, f"{name} as it is".encode(), name.encode())

    def _sizes(self, data: bytearray) -> None:
        index, code = struct.unpack_from("=I4s", data)
        struct.pack_into("=III", data, 8, 1, *known(self.modes[code.decode()], index))

    def _intervals(self, data: bytearray) -> None:
        index = struct.unpack_from("=I", data)[0]
        struct.pack_into("=III", data, 16, 1, 1, known(self.rates_hz, index))

    def _g_fmt(self, data: bytearray) -> None:
        struct.pack_into("=III", data, 8, 64, 48, 0)
        struct.pack_into("=I", data, 24, 2 * 64 + self.line_padding)

    def _g_parm(self, data: bytearray) -> None:
        struct.pack_into("=II", data, 12, 1, round(self.rate_hz))

    def _reqbufs(self, data: bytearray) -> None:
        if self.busy:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))

    def _queryctrl(self, data: bytearray) -> None:
        asked = struct.unpack_from("=I", data)[0]
        wanted = [n for n in sorted(self.controls) if n > asked & 0x7FFFFFFF] if asked >> 31 else [asked]
        if not wanted or wanted[0] not in self.controls:
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        c = self.controls[wanted[0]]
        struct.pack_into(
            "=II32siiiiI", data, 0, wanted[0], 1, c.name.encode(), c.minimum, c.maximum, c.step, 0, c.flags
        )

    def _g_ctrl(self, data: bytearray) -> None:
        struct.pack_into("=i", data, 4, self.controls[struct.unpack_from("=I", data)[0]].value)

    def _s_ctrl(self, data: bytearray) -> None:
        number, value = struct.unpack("=Ii", data)
        taken = self.controls[number].takes(value)
        if taken is None:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self.controls[number].value = taken


class FakeCapture:
    """`cv2.VideoCapture` on it."""

    def __init__(self, camera: FakeCamera, opened: bool) -> None:
        self._camera = camera
        self._opened = opened
        self._plug = camera.plugs
        self._format, self._size = next((name, sizes[0]) for name, sizes in camera.modes.items())
        self._asked: dict[int, float] = {}
        self._rate_hz = float(camera.rate_hz)
        self._stamp_ns = 0
        self._exposure = -1
        self._began_ns: int | None = None
        self._next = 0
        self._released = threading.Event()

    def isOpened(self) -> bool:  # noqa: N802
        return self._opened

    def set(self, prop: int, value: float) -> bool:
        """True whatever comes of it."""
        camera = self._camera
        if prop == cv2.CAP_PROP_FOURCC:
            name = int(value).to_bytes(4, "little").decode()
            self._format = name if name in camera.modes else next(iter(camera.modes))
        elif prop == cv2.CAP_PROP_FPS:
            self._rate_hz = min(camera.rates_hz, key=lambda rate: abs(rate - value))
            camera.rate_hz = self._rate_hz
        else:
            self._asked[prop] = value
            if prop == cv2.CAP_PROP_FRAME_HEIGHT:
                wanted = self._asked[cv2.CAP_PROP_FRAME_WIDTH], value
                self._size = min(camera.modes[self._format], key=lambda size: abs(np.subtract(size, wanted)).sum())
        return True

    def get(self, prop: int) -> float:
        values = {
            cv2.CAP_PROP_FOURCC: float(int.from_bytes(self._format.encode(), "little")),
            cv2.CAP_PROP_FRAME_WIDTH: float(self._size[0]),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self._size[1]),
            cv2.CAP_PROP_FPS: self._rate_hz,
            cv2.CAP_PROP_POS_MSEC: (self._stamp_ns + self._camera.stamp_offset_ns) // 1000 / 1000.0,
        }
        return values[prop]

    def grab(self) -> bool:
        """The oldest of at most four exposures that wait; those that found the queue full are lost."""
        camera = self._camera
        camera.grabs += 1
        if camera.errors > 0:
            camera.errors -= 1
            return False
        if self._began_ns is None:
            self._began_ns = time.monotonic_ns()
        end_s = time.monotonic() + camera.select_s
        while not (camera.gone or self._plug != camera.plugs or self._released.is_set()):
            exposed = self._newest()
            waiting = [n for n in range(self._next, exposed + 1) if not camera.lost(n)][:QUEUE]
            if waiting and not camera.silent:
                self._exposure, self._next = waiting[0], waiting[0] + 1
                if exposed - self._exposure > QUEUE:  # later ones were lost as long as nobody took any
                    self._filled(waiting, exposed)
                self._stamp_ns = self._began_ns + round(self._exposure * 1e9 / camera.rate_hz)
                return True
            if time.monotonic() > end_s:
                return False
            time.sleep(0.0005)
        return False

    def retrieve(self) -> tuple[bool, Any]:
        assert self._asked[cv2.CAP_PROP_CONVERT_RGB] == 0
        image = picture(self._exposure, *self._size)
        if self._format == "YUYV":
            return True, yuyv(image)
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_RST_INTERVAL, 4])
        raw = self._camera.spoil(self._exposure, data.tobytes())
        return True, np.frombuffer(raw, np.uint8).reshape(1, -1)

    def release(self) -> None:
        self._released.set()

    def _newest(self) -> int:
        assert self._began_ns is not None
        return int((time.monotonic_ns() - self._began_ns) * self._camera.rate_hz // 1_000_000_000)

    def _filled(self, waiting: list[int], exposed: int) -> None:
        """The queue keeps what it has; what came after it was full is gone."""
        kept, before = set(waiting), self._camera.lost
        gone = set(range(waiting[0], exposed)) - kept
        self._camera.lost = lambda number: number in gone or before(number)


def picture(number: int, width: int, height: int) -> Array:
    """(H, W, 3) BGR: its grey tells the number."""
    image = np.full((height, width, 3), number % 200 + 20, np.uint8)
    image[::8] = 255 - image[::8]
    return image


def yuyv(image: Array) -> Array:
    """(H, W, 3) BGR -> (H, W, 2)."""
    yuv = cv2.cvtColor(image, cv2.COLOR_BGR2YUV)
    chroma = np.empty(image.shape[:2], np.uint8)
    chroma[:, ::2], chroma[:, 1::2] = yuv[:, ::2, 1], yuv[:, ::2, 2]
    return np.stack([yuv[..., 0], chroma], axis=-1)


def known(entries: Any, index: int) -> Any:
    """An entry; EINVAL behind the last, as the kernel says it."""
    found = list(itertools.islice(entries, index, index + 1))
    if not found:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
    return found[0]
