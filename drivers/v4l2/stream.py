"""An opened camera that delivers: set up, read back, and every frame with its stamp.

What OpenCV 4.14 was seen to do with Linux' own test camera (vivid) is in `tests/hardware_in_vm/guest_camera.py`.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2

from viewsep.drivers.v4l2.controls import set_fixed, verify
from viewsep.drivers.v4l2.errors import CameraLost, SettingRefused
from viewsep.drivers.v4l2.listing import holders
from viewsep.drivers.v4l2.node import Node
from viewsep.drivers.v4l2.pictures import Damaged, whole
from viewsep.drivers.v4l2.settings import FORMATS, V4l2Settings
from viewsep.drivers.v4l2.system import THIS_MACHINE, Capture, System
from viewsep.errors import Timeout
from viewsep.interfaces import Clock
from viewsep.messages import Array

RATE_TOLERANCE = 0.02  # 29.97 is 30
SELECT_PERIODS = 3
FIRST_S = 5.0  # cameras take up to some seconds to start
OLDEST_NS = 2_000_000_000  # a stamp that is older than this is of another clock
FUTURE_PERIODS = 1.5  # vivid's, of the end of the frame, are 0.9 periods ahead; others are of another clock
FAST_SHARE = 0.5  # of the select timeout: a wait that ends sooner has not timed out


class NoFrame(Exception):
    """The wait ended without a frame; `waited` is False where it ended at once, as when the camera is gone."""

    def __init__(self, waited: bool) -> None:
        super().__init__("no frame")
        self.waited = waited


@dataclass(frozen=True, eq=False, slots=True)
class Exposure:
    """One frame as it came: bytes, moment of exposure and of arrival. `raw` is None and `fault` says why if damaged."""

    stamp_ns: int
    arrival_ns: int
    raw: Array | None
    fault: str = ""


class Stream:
    """Opens the camera at `path` with the settings, and makes sure that it took them.

    Raises CameraLost, SettingRefused. `remarks` are sentences about what is left to the camera.
    """

    def __init__(self, path: str, settings: V4l2Settings, clock: Clock, system: System = THIS_MACHINE) -> None:
        self.path = path
        self.remarks: tuple[str, ...] = ()
        self._settings = settings
        self._clock = clock
        self._system = system
        self._select_s = max(1, math.ceil(SELECT_PERIODS / settings.rate_hz))
        with Node(path, system) as node:
            self._check_free(node)
            self._capture = self._opened(node)
            try:
                self._set_up(node)
            except BaseException:
                self._capture.release()
                raise

    def close(self) -> None:
        """Give the camera back."""
        self._capture.release()

    def grab(self) -> Exposure:
        """Wait for the next frame, at most the select timeout. Raises NoFrame."""
        began_ns = self._clock.now_ns()
        grabbed = self._capture.grab()
        arrival_ns = self._clock.now_ns()
        if not grabbed:
            raise NoFrame(waited=arrival_ns - began_ns > FAST_SHARE * self._select_s * 1e9)
        stamp_ns = arrival_ns if self._settings.stamps == "arrival" else kernel_stamp_ns(self._capture)
        came, raw = self._capture.retrieve()
        try:
            return Exposure(stamp_ns, arrival_ns, whole(raw if came else None, self._settings))
        except Damaged as error:
            return Exposure(stamp_ns, arrival_ns, None, str(error))

    def first(self) -> Exposure:
        """The first frame that is not damaged; its stamp has to be of the clock. Raises Timeout, CameraLost."""
        deadline_ns = self._clock.now_ns() + round(FIRST_S * 1e9)
        fault = "it sends nothing"
        while self._clock.now_ns() < deadline_ns:
            try:
                exposure = self.grab()
            except NoFrame as error:
                if not error.waited:
                    raise CameraLost(f"the camera {self.path} gave an error instead of a picture: {REPLUG}") from None
                continue
            if exposure.raw is not None:
                self._check_stamp(exposure)
                return exposure
            fault = f"its pictures are damaged ({exposure.fault})"
        raise Timeout(f"the camera {self.path} delivered no frame within {FIRST_S:g} s: {fault}; {REPLUG}")

    def is_there(self) -> bool:
        """Whether the kernel still has the camera."""
        with suppress(CameraLost), Node(self.path, self._system) as node:
            return node.capability().captures
        return False

    def check_settings(self) -> None:
        """Read the controls back once more. Raises SettingRefused, CameraLost."""
        with Node(self.path, self._system) as node:
            verify(node, self._settings)

    def _check_free(self, node: Node) -> None:
        if not node.capability().captures:
            raise CameraLost(f"{self.path} gives no pictures: `viewsep camera list` lists the nodes that do")
        if node.is_busy():
            who = " and ".join(holders(self.path, self._system)) or "this process, or another user's"
            raise CameraLost(f"the camera {self.path} is used by {who}: end it, or use another camera")

    def _opened(self, node: Node) -> Capture:
        capture = self._system.capture(str(Path(self.path).resolve()), self._select_s)
        if not capture.isOpened():
            capture.release()
            raise CameraLost(
                f"OpenCV cannot open the camera {self.path}, whose formats are {_listed(node.formats())}: it needs one "
                "that it knows"
            )
        return capture

    def _set_up(self, node: Node) -> None:
        wanted, capture = self._settings, self._capture
        code = cv2.VideoWriter.fourcc(*wanted.format)
        for prop, value in (
            (cv2.CAP_PROP_FOURCC, code),
            (cv2.CAP_PROP_FRAME_WIDTH, wanted.width),
            (cv2.CAP_PROP_FRAME_HEIGHT, wanted.height),
            (cv2.CAP_PROP_FPS, wanted.rate_hz),  # the last: the others set it anew
            (cv2.CAP_PROP_CONVERT_RGB, 0),
        ):
            capture.set(prop, value)  # True or not: what counts is what it reads as
        if (got := round(capture.get(cv2.CAP_PROP_FOURCC))) != code:
            raise SettingRefused(
                f"the camera {self.path} has no format {wanted.format} (it took {_letters(got)}): "
                f"{_choice(node.formats())}"
            )
        size = round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if size != (wanted.width, wanted.height):
            known = _listed({f"{m.width} x {m.height}": 0 for m in node.modes() if m.format == wanted.format})
            raise SettingRefused(
                f"the camera {self.path} took {size[0]} x {size[1]} instead of {wanted.width} x {wanted.height}: with "
                f"{wanted.format} choose one of {known}"
            )
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        if rate_hz > 0 and abs(rate_hz / wanted.rate_hz - 1.0) > RATE_TOLERANCE:
            rates = next(
                (m.rates_hz for m in node.modes() if (m.format, m.width, m.height) == (wanted.format, *size)), ()
            )
            raise SettingRefused(
                f"the camera {self.path} took {rate_hz:g} pictures per second instead of {wanted.rate_hz}: with "
                f"{wanted.format} at {size[0]} x {size[1]} choose one of {_listed(f'{rate:g}' for rate in rates)}"
            )
        if wanted.format == "YUYV" and node.bytes_per_line() != 2 * wanted.width:
            raise SettingRefused(
                f"the camera {self.path} pads its lines of {wanted.width} pixels to {node.bytes_per_line()} bytes, "
                "which OpenCV does not take into account: choose another width, or MJPG"
            )
        self.remarks = set_fixed(node, wanted)
        if wanted.stamps == "arrival":
            self.remarks += ("frames are stamped when they arrive: later than they were exposed",)

    def _check_stamp(self, exposure: Exposure) -> None:
        age_ns = exposure.arrival_ns - exposure.stamp_ns
        if not -FUTURE_PERIODS * self._settings.period_ns <= age_ns <= OLDEST_NS:
            raise CameraLost(
                f"the camera {self.path} stamps its frames by another clock than the monotonic one: they are "
                f"{age_ns * 1e-9:.3g} s old on arrival. Set stamps = 'arrival' and turn slowly: they are late then"
            )


REPLUG = "check its cable, or plug it in again"


def kernel_stamp_ns(capture: Capture) -> int:
    """The driver's stamp of the newest frame: whole microseconds, which OpenCV gives as milliseconds."""
    return round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1000.0) * 1000


def _letters(code: int) -> str:
    return code.to_bytes(4, "little").decode("latin-1") if 0 <= code < 1 << 32 else str(code)


def _choice(formats: tuple[str, ...]) -> str:
    """The remedy for a format that the camera does not have."""
    known = [name for name in FORMATS if name in formats]
    return f"choose {' or '.join(known)}" if known else f"it has {_listed(formats)}, none of which viewsep reads"


def _listed(names: object) -> str:
    assert hasattr(names, "__iter__")
    return ", ".join(str(name) for name in names) or "those it does not tell"
