"""What a camera is set to."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.errors import BadConfig

FORMATS = ("MJPG", "YUYV")
STAMPS = ("kernel", "arrival")


@dataclass(frozen=True, slots=True)
class V4l2Settings:
    """A camera and its settings; those that are None are left as the camera has them, which `V4l2Camera.remarks` tells.

    `device` is a path below /dev/v4l/by-id or by-path, or /dev/videoN. `rate_hz` is a whole number since OpenCV takes
    no other. `exposure_ms` is in steps of 0.1 ms, `white_balance_k` in kelvin, `gain` and `focus` in the camera's own
    units. `stamps` is "kernel" for the moments that the driver notes, or "arrival" for cameras whose driver does not
    note them on the monotonic clock: late by what the picture takes to get here. A camera that sends nothing for
    `stall_s` is opened anew.
    """

    device: str
    format: str = "MJPG"
    width: int = 640
    height: int = 480
    rate_hz: int = 30
    exposure_ms: float | None = None
    white_balance_k: int | None = None
    gain: int | None = None
    focus: int | None = None
    stamps: str = "kernel"
    stall_s: float = 3.0

    @property
    def period_ns(self) -> int:
        """Between two exposures."""
        return round(1e9 / self.rate_hz)

    def check(self) -> None:
        """Raises BadConfig for what no camera can do, naming value and remedy."""
        if not self.device:
            raise BadConfig("the camera's device is missing: `viewsep camera list` lists those there are")
        for name, value, known in (("format", self.format, FORMATS), ("stamps", self.stamps, STAMPS)):
            if value not in known:
                raise BadConfig(f"{name} = {value!r} of the camera is unknown: choose {' or '.join(known)}")
        for name, number in (("width", self.width), ("height", self.height), ("rate_hz", self.rate_hz)):
            if number < 1:
                raise BadConfig(f"{name} = {number} of the camera has to be at least 1")
        if self.format == "YUYV" and self.width % 2:
            raise BadConfig(f"width = {self.width} of the camera has to be even with format = 'YUYV'")
        if self.exposure_ms is not None and not 0.1 <= self.exposure_ms <= 60_000:
            raise BadConfig(f"exposure_ms = {self.exposure_ms:g} of the camera has to be 0.1 to 60000")
        if not self.stall_s > 0:
            raise BadConfig(f"stall_s = {self.stall_s:g} of the camera has to be more than 0")
