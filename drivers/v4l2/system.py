"""What a camera touches of this machine; tests give it another one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2

SELECT_TIMEOUT = "OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"


class Capture(Protocol):
    """The calls of `cv2.VideoCapture` that are used. With the backend CAP_V4L2 of OpenCV 4.14:

    `set` returns True also where the camera takes another value; `grab` returns False after the select timeout (10 s
    unless the environment says otherwise), and at once and for ever when the camera is gone, `isOpened` staying True.
    """

    def isOpened(self) -> bool:  # noqa: N802
        """Whether it was opened."""
        ...

    def set(self, prop: int, value: float, /) -> bool:
        """Ask for a setting."""
        ...

    def get(self, prop: int, /) -> float:
        """Read a setting, or a property of the newest frame."""
        ...

    def grab(self) -> bool:
        """Wait for the next frame."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """The frame that was grabbed."""
        ...

    def release(self) -> None:
        """Give the device back."""
        ...


def open_capture(path: str, timeout_s: int) -> Capture:
    """OpenCV's capture of a device node; it waits at most `timeout_s` (whole seconds) for a frame."""
    os.environ[SELECT_TIMEOUT] = str(timeout_s)
    return cv2.VideoCapture(path, cv2.CAP_V4L2)


def ioctl(file: int, request: int, data: bytearray) -> None:
    """The kernel's ioctl; fills `data`. Raises OSError."""
    fcntl.ioctl(file, request, data, True)


@dataclass(frozen=True, slots=True)
class System:
    """Where devices are found, how they are opened and asked."""

    dev: Path = Path("/dev")
    sysfs: Path = Path("/sys/class/video4linux")
    proc: Path = Path("/proc")
    capture: Callable[[str, int], Capture] = open_capture
    ioctl: Callable[[int, int, bytearray], None] = ioctl


THIS_MACHINE = System()
