"""The rig's devices, shared by all who use them in one process: one call at a time, stopped when nobody is heard."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from viewsep.errors import NotConnected, RigError, Timeout
from viewsep.interfaces import CameraSource, Clock, JointLimits, MotionBackend
from viewsep.messages import Frame, JointState
from viewsep.service.lease import Lease

WATCH_S = 0.02
RING = 8  # frames that readers find without waiting
CAPTURE_TIMEOUT_S = 0.1  # one wait of the capture thread, on the rig's clock
BEHIND_NS = 250_000_000  # how late frames may come before some are skipped
RATE_WINDOW_S = 2.0
RETRY_S = 0.5  # between two attempts to open a camera that failed
LOOK_AGAIN_S = 0.005  # readers look at the rig's clock at least that often: it may run faster than the wall


class SharedMotion:
    """A `MotionBackend` for any number of threads, and the watch over its lease.

    Its own calls ask nobody's leave: they are for whoever serves the rig. Others use `commanded_by`. From `connect` to
    `close` a thread stops the motion when the holder of the lease falls silent; what it cannot do is a fault. A holder
    that is heard again finds its move going on.
    """

    def __init__(self, motion: MotionBackend, lease: Lease) -> None:
        self.lease = lease
        self._motion = motion
        self._lock = threading.Lock()
        self._goal: tuple[float, ...] | None = None  # of the present holder's move
        self._paused = False
        self._trouble = ""
        self._ending = threading.Event()
        self._watch: threading.Thread | None = None

    def commanded_by(self, holder: str) -> MotionBackend:
        """The motion as one holder of the lease sees it. `connect` takes the lease, `close` stops and gives it back.

        Every other call but `limits` renews the lease and raises LeaseLost when it is gone.
        """
        return _Commanded(self, holder)

    def acquire(self, holder: str) -> None:
        """Take the lease and begin anew: what a holder who fell silent had under way is stopped and forgotten.

        Raises Refused (busy), RigError.
        """
        with self._lock:
            if self.lease.acquire(holder):
                self._forget_move()
                self._motion.stop()

    def release(self, holder: str) -> None:
        """Stop and give the lease back; does nothing when `holder` does not hold it. Raises RigError."""
        with self._lock:
            if self.lease.release(holder):
                self._forget_move()
                self._motion.stop()

    def halt(self, reason: str) -> None:
        """Take the lease away, then stop. `reason` is a sentence that the holder gets. Raises RigError."""
        self.lease.revoke(reason)
        self.stop()

    @contextmanager
    def used_by(self, holder: str, *, resume: bool = True) -> Iterator[MotionBackend]:
        """The backend for one call of the holder. A move that was stopped in its silence goes on if `resume`.

        Raises LeaseLost.
        """
        with self._lock:
            self.lease.renew(holder)
            if self._paused:
                self._paused = False
                if resume and self._goal is not None:
                    self._motion.move_to(self._goal)
            yield self._motion

    def connect(self) -> None:
        """Open the device and begin to watch. Raises RigError."""
        with self._lock:
            self._motion.connect()
        if self._watch is None:
            self._ending.clear()
            self._watch = threading.Thread(target=self._watch_lease, name="viewsep lease watch", daemon=True)
            self._watch.start()

    def limits(self) -> tuple[JointLimits, ...]:
        """Limits of every joint."""
        return self._motion.limits()

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving, whoever holds the lease. Raises MoveRefused, RigError."""
        with self._lock:
            commanded = self._motion.move_to(position_rad)
            self._forget_move()
            return commanded

    def move_for(self, holder: str, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start the holder's move, and remember it in case it has to be taken up again. Raises LeaseLost, RigError."""
        with self.used_by(holder, resume=False) as motion:
            commanded = motion.move_to(position_rad)
            self._goal = tuple(position_rad)
            return commanded

    def read_state(self) -> JointState:
        """The newest read-back. Raises RigError."""
        with self._lock:
            return self._motion.read_state()

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Read-backs from the last one at or before `since_ns` on. Raises RigError."""
        with self._lock:
            return self._motion.history(since_ns)

    def stop(self) -> None:
        """Stop all joints, whoever holds the lease. Raises RigError."""
        with self._lock:
            self._forget_move()
            self._motion.stop()

    def stop_for(self, holder: str) -> None:
        """Stop for the holder. Raises LeaseLost, RigError."""
        with self.used_by(holder, resume=False) as motion:
            self._forget_move()
            motion.stop()

    def fault(self) -> str:
        """What the watch could not do, or the device's fault; empty when all is well."""
        with self._lock:
            return self._trouble or self._motion.fault()

    def clear_fault(self) -> None:
        """Clear what can be cleared. Raises RigError."""
        with self._lock:
            self._trouble = ""
            self._motion.clear_fault()

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The newest temperature of every joint."""
        with self._lock:
            return self._motion.temperatures_c()

    def counters(self) -> Mapping[str, int]:
        """What was counted on the way to the device."""
        return self._motion.counters()

    def close(self) -> None:
        """Stop watching, stop and release the device. Raises RigError."""
        self._ending.set()
        watch, self._watch = self._watch, None
        if watch is not None:
            watch.join()
        with self._lock:
            self._forget_move()
            self._motion.close()

    def _forget_move(self) -> None:
        self._goal, self._paused = None, False

    def _watch_lease(self) -> None:
        while not self._ending.wait(WATCH_S):
            try:
                with self._lock:
                    if self.lease.lapsed() and not self._paused:
                        self._motion.stop()
                        self._paused = True
            except Exception as error:  # tried again at once, and told until somebody clears it
                self._trouble = f"the motion could not be stopped when {self.lease.holder} fell silent: {error}"


class _Commanded:
    """`SharedMotion` for one holder."""

    def __init__(self, shared: SharedMotion, holder: str) -> None:
        self._shared = shared
        self._holder = holder

    def connect(self) -> None:
        self._shared.acquire(self._holder)

    def limits(self) -> tuple[JointLimits, ...]:
        return self._shared.limits()

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        return self._shared.move_for(self._holder, position_rad)

    def read_state(self) -> JointState:
        with self._shared.used_by(self._holder) as motion:
            return motion.read_state()

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        with self._shared.used_by(self._holder) as motion:
            return motion.history(since_ns)

    def stop(self) -> None:
        self._shared.stop_for(self._holder)

    def fault(self) -> str:
        with self._shared.used_by(self._holder):
            pass
        return self._shared.fault()

    def clear_fault(self) -> None:
        with self._shared.used_by(self._holder):
            pass
        self._shared.clear_fault()

    def temperatures_c(self) -> tuple[float | None, ...]:
        with self._shared.used_by(self._holder) as motion:
            return motion.temperatures_c()

    def counters(self) -> Mapping[str, int]:
        with self._shared.used_by(self._holder) as motion:
            return motion.counters()

    def close(self) -> None:
        self._shared.release(self._holder)


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """How the camera does. `newest_age_s` is None before the first frame, `problem` empty when all is well."""

    connected: bool
    rate_hz: float
    newest_age_s: float | None
    drops: int
    problem: str


class SharedCamera:
    """A `CameraSource` for any number of readers.

    One thread reads the device and keeps the last `RING` frames; a camera that fails is opened again until it comes
    back, and until then every reader gets RigError. With a stepped clock there is no thread: frames exist only when
    somebody waits for them, so readers take turns at the device.
    """

    def __init__(self, camera: CameraSource, clock: Clock, *, stepped: bool) -> None:
        self._camera = camera
        self._clock = clock
        self._stepped = stepped
        self._listeners: list[Callable[[Frame], None]] = []
        self._turn = threading.Lock()
        self._news = threading.Condition()  # guards all below
        self._connected = False
        self._ring: deque[tuple[Frame, int]] = deque(maxlen=RING)  # with the drops up to it
        self._arrivals_ns: deque[int] = deque()
        self._connected_ns = 0
        self._drops = self._drops_read = 0
        self._problem = self._listener_problem = ""
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def on_frame(self, listener: Callable[[Frame], None]) -> None:
        """Tell `listener` of every frame from now on, on the thread that read it."""
        self._listeners.append(listener)

    def connect(self) -> None:
        """Open the device and begin to read it. Raises RigError."""
        self._camera.connect()
        with self._news:
            self._connected = True
            self._connected_ns = self._clock.now_ns()
            self._drops = self._drops_read = 0
            self._ring.clear()
            self._arrivals_ns.clear()
            self._problem = ""
        if not self._stepped and self._thread is None:
            self._ending.clear()
            self._thread = threading.Thread(target=self._capture, name="viewsep camera", daemon=True)
            self._thread.start()

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first frame remembered or coming that was exposed after `newer_than_ns`. Raises Timeout, RigError."""
        return self._read_device(newer_than_ns, timeout_s) if self._stepped else self._wait(newer_than_ns, timeout_s)

    @property
    def drops(self) -> int:
        """Exposures that never arrived since `connect()`, up to the newest frame that somebody read."""
        return self._camera.drops if self._stepped else self._drops_read

    def health(self) -> CameraHealth:
        """Rate over the last seconds, age of the newest frame, drops, and what is wrong."""
        now_ns = self._clock.now_ns()
        with self._news:
            window_ns = min(round(RATE_WINDOW_S * 1e9), max(now_ns - self._connected_ns, 1))
            recent = sum(arrival_ns > now_ns - window_ns for arrival_ns in self._arrivals_ns)
            newest = self._ring[-1][0] if self._ring else None
            return CameraHealth(
                self._connected,
                recent / window_ns * 1e9,
                None if newest is None else (now_ns - newest.stamp_ns) * 1e-9,
                self._camera.drops if self._stepped else self._drops,
                self._problem or self._listener_problem,
            )

    def close(self) -> None:
        """Stop reading and release the device; readers that still wait get NotConnected. Safe to call twice."""
        with self._news:
            self._connected = False
            self._news.notify_all()
        self._ending.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        with self._turn:
            self._camera.close()

    def _read_device(self, newer_than_ns: int, timeout_s: float) -> Frame:
        with self._turn:
            frame = self._camera.read(newer_than_ns, timeout_s)
            self._take(frame)
        self._tell(frame)
        return frame

    def _wait(self, newer_than_ns: int, timeout_s: float) -> Frame:
        deadline_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        with self._news:
            while True:
                if not self._connected:
                    raise NotConnected("the camera is not connected: call connect() first")
                for frame, drops in self._ring:
                    if frame.stamp_ns > newer_than_ns:
                        self._drops_read = max(self._drops_read, drops)
                        return frame
                if self._problem:
                    raise RigError(self._problem)
                left_ns = deadline_ns - self._clock.now_ns()
                if left_ns <= 0:
                    raise Timeout(f"the camera delivered no frame within {timeout_s:g} s")
                self._news.wait(min(left_ns * 1e-9, LOOK_AGAIN_S))

    def _capture(self) -> None:
        """The only reader of the device. Frames that come too late are caught up with by skipping some."""
        newest_ns, least_delay_ns, broken = self._clock.now_ns(), 1 << 62, False
        while not self._ending.is_set():
            try:
                if broken:
                    self._open_again()
                    broken = False
                frame = self._camera.read(newest_ns, CAPTURE_TIMEOUT_S)
            except Timeout:
                continue
            except Exception as error:
                broken = True
                with self._news:
                    self._problem = str(error) if isinstance(error, RigError) else f"the camera failed: {error!r}"
                    self._news.notify_all()
                self._ending.wait(RETRY_S)
                continue
            delay_ns = self._clock.now_ns() - frame.stamp_ns
            least_delay_ns = min(least_delay_ns, delay_ns)
            behind_ns = delay_ns - least_delay_ns
            newest_ns = frame.stamp_ns + (behind_ns if behind_ns > BEHIND_NS else 0)
            self._take(frame)
            self._tell(frame)

    def _open_again(self) -> None:
        with suppress(Exception):  # a device that failed may not even close
            self._camera.close()
        self._camera.connect()
        with self._news:
            self._problem = ""

    def _take(self, frame: Frame) -> None:
        now_ns = self._clock.now_ns()
        with self._news:
            if self._ring:
                self._drops += max(0, frame.sequence - self._ring[-1][0].sequence - 1)
            self._ring.append((frame, self._drops))
            self._arrivals_ns.append(now_ns)
            while self._arrivals_ns[0] < now_ns - round(RATE_WINDOW_S * 1e9):
                self._arrivals_ns.popleft()
            self._news.notify_all()

    def _tell(self, frame: Frame) -> None:
        for listener in self._listeners:
            try:
                listener(frame)
            except Exception as error:  # one listener must not take the camera from all others
                self._listener_problem = f"a listener to the camera failed: {error!r}"
