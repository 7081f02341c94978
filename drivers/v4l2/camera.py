"""A camera with a Linux driver: a `CameraSource`.

One thread takes every frame as it comes, so that none waits in the driver's queue (OpenCV keeps four: after a pause the
next four are old), and keeps the last few undecoded; whoever reads one decodes it. A camera that is unplugged or falls
silent is opened anew by the name that stays, until it is back; meanwhile readers are told.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from viewsep.drivers.v4l2.errors import CameraError, CameraLost
from viewsep.drivers.v4l2.exposures import Exposures
from viewsep.drivers.v4l2.listing import stable_name
from viewsep.drivers.v4l2.pictures import Damaged, decoded
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.drivers.v4l2.stream import REPLUG, Exposure, NoFrame, Stream
from viewsep.drivers.v4l2.system import THIS_MACHINE, System
from viewsep.errors import NotConnected, RigError, Timeout
from viewsep.interfaces import Clock
from viewsep.messages import Array, Frame

KEPT = 16
MEASURED = 6  # frames at the beginning that tell the real rate
AGAIN_S = 0.25  # between two tries to open a lost camera
ERRORS, ERROR_PAUSE_S = 10, 0.02  # in a row, after which a camera that is still there counts as lost
LOOK_AGAIN_S = 0.05
END_S = 10.0


@dataclass(eq=False, slots=True)
class _Kept:
    """A frame that nobody may have read yet, and what was lost before it. Damage may show only when it is decoded."""

    stamp_ns: int
    sequence: int
    raw: Array
    drops: int
    damaged: bool = False


class V4l2Camera:
    """`CameraSource` for any number of readers; `clock` has to be the machine's monotonic one. Raises BadConfig."""

    def __init__(self, settings: V4l2Settings, clock: Clock, system: System = THIS_MACHINE) -> None:
        settings.check()
        self._settings = settings
        self._clock = clock
        self._system = system
        self._name = settings.device
        self._stream: Stream | None = None  # of the thread alone once that runs
        self._news = threading.Condition()  # guards all below
        self._connected = False
        self._remarks: tuple[str, ...] = ()
        self._kept: deque[_Kept] = deque(maxlen=KEPT)
        self._exposures = Exposures(settings.period_ns)
        self._last_sequence = -1
        self._last_stamp_ns = 0
        self._lost = self._undecodable = self._drops_read = 0
        self._problem = self._silence = ""
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def connect(self) -> None:
        """Open the camera, set it up, read the settings and the first frames back, and begin to take all that come.

        Raises CameraLost, SettingRefused, Timeout.
        """
        if self._thread is not None:
            return
        stream = Stream(self._settings.device, self._settings, self._clock, self._system)
        try:
            first = [stream.first()]
            while len(first) < MEASURED:
                first.append(stream.first())
            stream.check_settings()
        except BaseException:
            stream.close()
            raise
        self._name = stable_name(self._settings.device, self._system)
        with self._news:
            self._stream, self._remarks = stream, stream.remarks
            self._kept.clear()
            self._exposures = Exposures(self._settings.period_ns)
            for earlier, later in pairwise(first):
                self._exposures.learn(later.stamp_ns - earlier.stamp_ns)
            self._last_sequence, self._last_stamp_ns = -1, first[-1].stamp_ns
            self._lost = self._undecodable = self._drops_read = 0
            self._problem = self._silence = ""
            self._connected = True
        self._ending.clear()
        self._thread = threading.Thread(target=self._take_all, name="viewsep camera device", daemon=True)
        self._thread.start()

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first frame kept or coming that was exposed after `newer_than_ns`.

        Raises NotConnected, Timeout, and CameraLost while the camera is gone.
        """
        deadline_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            kept = self._wait(newer_than_ns, deadline_ns, timeout_s)
            try:
                image = decoded(kept.raw, self._settings)
            except Damaged:
                with self._news:
                    self._undecodable += not kept.damaged
                    kept.damaged = True
                continue
            with self._news:
                self._drops_read = max(self._drops_read, kept.drops + self._undecodable)
            return Frame(kept.stamp_ns, kept.sequence, image, None)

    @property
    def drops(self) -> int:
        """Exposures that never arrived or were damaged since `connect()`, up to the newest frame that was read."""
        return self._drops_read

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about what is left to the camera, known once it is connected."""
        return self._remarks

    def close(self) -> None:
        """Give the camera back; readers that still wait get NotConnected. Raises CameraError if the driver hangs."""
        with self._news:
            self._connected = False
            self._news.notify_all()
        self._ending.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(END_S)
            if thread.is_alive():
                raise CameraError(f"the driver of the camera {self._name} does not come back: plug the camera out")

    def _wait(self, newer_than_ns: int, deadline_ns: int, timeout_s: float) -> _Kept:
        with self._news:
            while True:
                if not self._connected:
                    raise NotConnected(f"the camera {self._name} is not connected: call connect() first")
                for kept in self._kept:
                    if kept.stamp_ns > newer_than_ns and not kept.damaged:
                        return kept
                if self._problem:
                    raise CameraLost(self._problem)
                left_ns = deadline_ns - self._clock.now_ns()
                if left_ns <= 0:
                    why = f": {self._silence}" if self._silence else ""
                    raise Timeout(f"the camera {self._name} delivered no frame within {timeout_s:g} s{why}")
                self._news.wait(min(left_ns * 1e-9, LOOK_AGAIN_S))

    def _take_all(self) -> None:
        """The thread: takes every frame, and opens the camera anew when it has to."""
        try:
            while not self._ending.is_set():
                try:
                    if self._stream is None:
                        self._open_again()
                    self._take_until_lost()
                except RigError as error:
                    self._give_up(str(error))
                except Exception as error:  # whatever it is, somebody must hear of it
                    self._give_up(f"reading the camera {self._name} failed: {error!r}")
        finally:
            self._release()

    def _take_until_lost(self) -> None:
        """Raises CameraLost when no more frames will come."""
        assert self._stream is not None
        errors, heard_ns = 0, self._clock.now_ns()
        while not self._ending.is_set():
            try:
                exposure = self._stream.grab()
            except NoFrame as error:
                errors = 0 if error.waited else errors + 1
                if not error.waited and not self._stream.is_there():
                    raise CameraLost(f"the camera {self._name} is gone: {REPLUG}") from None
                if errors > ERRORS:
                    told = f"the camera {self._name} gives errors instead of pictures: it is opened anew; {REPLUG}"
                    raise CameraLost(told) from None
                self._stay_silent((self._clock.now_ns() - heard_ns) * 1e-9)
                if not error.waited:
                    self._ending.wait(ERROR_PAUSE_S)
                continue
            errors, heard_ns = 0, self._clock.now_ns()
            self._keep(exposure)

    def _stay_silent(self, silent_s: float) -> None:
        """Nothing came. Raises CameraLost when that lasts."""
        told = f"it has sent nothing for {silent_s:.1f} s"
        if silent_s > self._settings.stall_s:
            raise CameraLost(f"the camera {self._name} is silent: {told}; it is opened anew; {REPLUG}")
        with self._news:
            self._silence = told

    def _keep(self, exposure: Exposure) -> None:
        with self._news:
            self._silence = ""
            if exposure.stamp_ns <= self._last_stamp_ns:  # a driver that repeats itself
                return
            self._last_stamp_ns = exposure.stamp_ns
            sequence = self._exposures.number(exposure.stamp_ns)
            if exposure.raw is None:
                return  # counted as lost with the next whole one
            self._lost += sequence - self._last_sequence - 1
            self._last_sequence = sequence
            moment_ns = min(exposure.stamp_ns, exposure.arrival_ns)  # nothing is seen before it happens
            self._kept.append(_Kept(moment_ns, sequence, exposure.raw, self._lost))
            self._news.notify_all()

    def _open_again(self) -> None:
        """Raises RigError while it is not back as it was."""
        stream = Stream(self._name, self._settings, self._clock, self._system)
        try:
            first = stream.first()
            stream.check_settings()
        except BaseException:
            stream.close()
            raise
        self._stream = stream
        with self._news:
            self._exposures.restart()
            self._problem = ""
        self._keep(first)

    def _give_up(self, problem: str) -> None:
        """Tell readers, let the device go, so that it can come back, and wait a little."""
        with self._news:
            self._problem = problem
            self._news.notify_all()
        self._release()
        self._ending.wait(AGAIN_S)

    def _release(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()
