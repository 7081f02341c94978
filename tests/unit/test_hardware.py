"""Shared devices: stopped when nobody is heard, read by one thread, used again when they come back."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rig_on_zenoh import wait_for

from viewsep.clock import MonotonicClock
from viewsep.errors import LeaseLost, NotConnected, RigError, Timeout
from viewsep.interfaces import JointLimits
from viewsep.kinematics import preset
from viewsep.messages import Frame, JointState
from viewsep.service.hardware import RETRY_S, SharedCamera, SharedMotion
from viewsep.service.lease import Lease
from viewsep.service.requests import Refused
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.world import SimWorld

LIMITS = (JointLimits("pan", -10.0, 10.0, 1.0),)


@dataclass
class NotedMotion:
    """Writes down what it is told; its stop breaks as often as `breaks` says."""

    told: list[object] = field(default_factory=list)
    breaks: int = 0

    def connect(self) -> None:
        pass

    def limits(self) -> tuple[JointLimits, ...]:
        return LIMITS

    def move_to(self, position_rad: object) -> tuple[float, ...]:
        assert isinstance(position_rad, tuple)
        self.told.append(position_rad)
        return position_rad

    def read_state(self) -> JointState:
        return JointState(0, (0.0,), (0.0,), False)

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        return (self.read_state(),)

    def stop(self) -> None:
        if self.breaks > 0:
            self.breaks -= 1
            raise RigError("the bus is silent")
        self.told.append("stop")

    def fault(self) -> str:
        return ""

    def clear_fault(self) -> None:
        pass

    def temperatures_c(self) -> tuple[float | None, ...]:
        return (None,)

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        pass


@dataclass
class Shared:
    device: NotedMotion
    motion: SharedMotion
    lease: Lease
    now_s: float = 0.0


@pytest.fixture
def shared() -> Iterator[Shared]:
    device = NotedMotion()
    lease = Lease(1.0, lambda: case.now_s)
    case = Shared(device, SharedMotion(device, lease), lease)
    case.motion.connect()
    yield case
    case.motion.close()


def test_a_holder_that_falls_silent_is_stopped_once_and_goes_on_when_it_is_back(shared: Shared) -> None:
    anna = shared.motion.commanded_by("anna")
    anna.connect()
    anna.move_to((1.0,))
    shared.now_s = 1.0
    wait_for(lambda: shared.device.told == [(1.0,), "stop"])
    anna.read_state()
    anna.read_state()
    assert shared.device.told == [(1.0,), "stop", (1.0,)]
    shared.now_s = 2.0
    wait_for(lambda: shared.device.told[3:] == ["stop"])
    anna.move_to((2.0,))
    anna.read_state()
    assert shared.device.told[4:] == [(2.0,)]  # what was under way before is forgotten


def test_a_stop_is_not_followed_by_the_move_before_it(shared: Shared) -> None:
    anna = shared.motion.commanded_by("anna")
    anna.connect()
    anna.move_to((1.0,))
    anna.stop()
    shared.now_s = 1.0
    wait_for(lambda: shared.device.told == [(1.0,), "stop", "stop"])
    anna.read_state()
    assert shared.device.told == [(1.0,), "stop", "stop"]


def test_who_begins_anew_after_a_silence_does_not_find_the_old_move(shared: Shared) -> None:
    anna = shared.motion.commanded_by("anna")
    anna.connect()
    anna.move_to((1.0,))
    shared.now_s = 1.0
    anna.connect()
    told = list(shared.device.told)
    assert told[-1] == "stop"
    anna.read_state()
    assert shared.device.told == told


def test_who_takes_over_finds_the_rig_stopped(shared: Shared) -> None:
    anna, ben = shared.motion.commanded_by("anna"), shared.motion.commanded_by("ben")
    anna.connect()
    anna.move_to((1.0,))
    with pytest.raises(Refused, match="anna"):
        ben.connect()
    shared.now_s = 1.0
    ben.connect()
    assert "stop" in shared.device.told
    with pytest.raises(LeaseLost, match="ben has taken the rig"):
        anna.move_to((3.0,))
    ben.move_to((2.0,))
    anna.close()
    ben.close()
    assert shared.device.told[-2:] == [(2.0,), "stop"]
    assert shared.lease.holder == ""


@pytest.mark.parametrize(
    "call", ["move_to", "stop", "read_state", "history", "fault", "clear_fault", "temperatures_c", "counters"]
)
def test_who_was_halted_can_do_no_more(shared: Shared, call: str) -> None:
    anna = shared.motion.commanded_by("anna")
    anna.connect()
    anna.move_to((1.0,))
    shared.motion.halt("the operator stopped the rig")
    assert shared.device.told[-1] == "stop"
    arguments = {"move_to": ((2.0,),), "history": (0,)}.get(call, ())
    with pytest.raises(LeaseLost, match="the operator stopped the rig"):
        getattr(anna, call)(*arguments)
    assert shared.device.told[-1] == "stop"


def test_what_the_watch_cannot_do_is_tried_again_and_told(shared: Shared) -> None:
    shared.device.breaks = 3
    anna = shared.motion.commanded_by("anna")
    anna.connect()
    shared.now_s = 1.0
    wait_for(lambda: shared.device.told == ["stop"])
    assert "could not be stopped when anna fell silent: the bus is silent" in shared.motion.fault()
    shared.motion.clear_fault()
    assert shared.motion.fault() == ""


def test_no_thread_is_left(shared: Shared) -> None:
    camera = SharedCamera(Blinking(), MonotonicClock(), stepped=False)
    camera.connect()
    assert {thread.name for thread in threading.enumerate()} >= {"viewsep lease watch", "viewsep camera"}
    camera.close()
    shared.motion.close()
    assert [thread for thread in threading.enumerate() if thread.name.startswith("viewsep")] == []


# ---- camera ----


@dataclass
class Blinking:
    """A frame every millisecond or two; errors while `breaks` is set, until it is opened again when it is not."""

    breaks: Exception | None = None
    sequence: int = 0
    step: int = 1
    is_open: bool = False
    readers: set[int] = field(default_factory=set)
    opened: int = 0
    clock: MonotonicClock = field(default_factory=MonotonicClock)

    def connect(self) -> None:
        if self.breaks is not None:
            raise self.breaks
        self.is_open = True
        self.opened += 1

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        self.readers.add(threading.get_ident())
        if self.breaks is not None:
            self.is_open = False
            raise self.breaks
        assert self.is_open
        self.clock.sleep_until(max(newer_than_ns, self.clock.now_ns()) + 1_500_000)
        self.sequence += self.step
        return Frame(self.clock.now_ns(), self.sequence, np.zeros((2, 2, 3), np.uint8), None)

    @property
    def drops(self) -> int:
        return 0

    def close(self) -> None:
        self.is_open = False


@pytest.fixture
def blinking() -> Blinking:
    return Blinking()


@pytest.fixture
def camera(blinking: Blinking) -> Iterator[SharedCamera]:
    camera = SharedCamera(blinking, MonotonicClock(), stepped=False)
    camera.connect()
    yield camera
    camera.close()


def in_threads(count: int, work: Callable[[], None]) -> None:
    """Do the work in threads; what goes wrong there goes wrong here."""
    errors: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=guarded) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []


@pytest.mark.alone
def test_any_number_of_readers_get_frames_and_one_thread_reads_the_device(
    camera: SharedCamera, blinking: Blinking
) -> None:
    seen: list[Frame] = []
    camera.on_frame(seen.append)

    def read() -> None:
        newest_ns = 0
        for _ in range(20):
            frame = camera.read(newest_ns, 5.0)
            assert frame.stamp_ns > newest_ns
            newest_ns = frame.stamp_ns

    in_threads(4, read)
    assert len(blinking.readers) == 1
    assert len(seen) >= 20
    assert [b.sequence - a.sequence for a, b in itertools.pairwise(seen)] == [1] * (len(seen) - 1)
    health = camera.health()
    assert health.connected
    assert health.rate_hz > 0.0
    assert health.newest_age_s is not None
    assert (health.drops, health.problem) == (0, "")


@pytest.mark.needs_pybullet
def test_a_stepped_camera_is_read_by_whoever_asks_and_counts_its_rate(product_mesh: Path) -> None:
    clock = SimClock()
    world = SimWorld(preset("gimbal"), clock, 0, Disturbances())
    camera = SharedCamera(SimCamera(world, MeshRenderer(product_mesh, CameraOptics(32)), 25.0), clock, stepped=True)
    heard: list[Frame] = []
    camera.on_frame(heard.append)
    camera.connect()
    assert [thread for thread in threading.enumerate() if thread.name.startswith("viewsep")] == []
    frames = [camera.read(clock.now_ns(), 1.0) for _ in range(75)]
    health = camera.health()
    camera.close()
    world.close()
    assert heard == frames
    assert health.rate_hz == pytest.approx(25.0, abs=1.0)
    assert health.newest_age_s == 0.0


@pytest.mark.alone
@pytest.mark.needs_pybullet
def test_a_camera_faster_than_its_reader_is_kept_up_with_by_skipping_frames(product_mesh: Path) -> None:
    clock = PacedClock(30.0)
    world = SimWorld(preset("gimbal"), clock, 0, Disturbances())
    camera = SharedCamera(SimCamera(world, MeshRenderer(product_mesh, CameraOptics(128))), clock, stepped=False)
    camera.connect()
    end_ns = clock.now_ns() + 30 * 10**9
    wait_for(lambda: clock.now_ns() > end_ns)  # 900 exposures in a second
    health = camera.health()
    camera.close()
    world.close()
    assert health.drops > 0
    assert health.newest_age_s is not None
    assert health.newest_age_s < 9.0  # without skipping some 20


def test_gaps_are_drops(camera: SharedCamera, blinking: Blinking) -> None:
    blinking.step = 3
    wait_for(lambda: camera.health().drops > 10)
    first = camera.read(0, 5.0)
    before = camera.drops
    later = camera.read(MonotonicClock().now_ns(), 5.0)
    assert camera.drops - before == (later.sequence - first.sequence) // 3 * 2


@pytest.mark.parametrize("error", [RigError("the camera was unplugged"), OSError("no such device")])
def test_a_camera_that_fails_is_told_to_every_reader_and_used_again_when_it_is_back(
    camera: SharedCamera, blinking: Blinking, error: Exception
) -> None:
    def fails() -> None:
        with pytest.raises(RigError, match=str(error)):
            camera.read(MonotonicClock().now_ns() + 10**9, 20.0)

    camera.read(0, 5.0)
    blinking.breaks = error
    in_threads(3, fails)
    assert str(error) in camera.health().problem
    blinking.breaks = None
    wait_for(lambda: camera.health().problem == "", RETRY_S + 10.0)
    assert camera.read(MonotonicClock().now_ns(), 5.0).sequence > 0
    assert blinking.opened == 2


def test_closing_frees_those_who_wait(camera: SharedCamera) -> None:
    closer = threading.Timer(0.05, camera.close)
    closer.start()
    with pytest.raises(NotConnected):
        camera.read(MonotonicClock().now_ns() + 60 * 10**9, 30.0)
    closer.join()


def test_a_listener_that_fails_takes_the_camera_from_nobody(camera: SharedCamera) -> None:
    def bad(_frame: Frame) -> None:
        raise ValueError("no room")

    camera.on_frame(bad)
    now_ns = MonotonicClock().now_ns()
    camera.read(camera.read(now_ns, 5.0).stamp_ns, 5.0)
    wait_for(lambda: "no room" in camera.health().problem)


def test_an_old_frame_is_none_that_was_asked_for(camera: SharedCamera) -> None:
    with pytest.raises(Timeout, match=r"no frame within 0\.05 s"):
        camera.read(MonotonicClock().now_ns() + 10**10, 0.05)
