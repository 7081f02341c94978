"""A simulated rig before a camera that gives no masks, where things go wrong; tasks on it are recorded and replayed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.drivers.v4l2.errors import CameraLost
from viewsep.errors import RigError
from viewsep.kinematics import preset
from viewsep.messages import Array, FloatArray, Frame, Message, Result
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.perception.background import Background, BackgroundModel, learn_background
from viewsep.perception.empty_rig import captured
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.plugins import make_descriptor
from viewsep.recording import task_recorder
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.replay import verify
from viewsep.rigs import pace_of
from viewsep.session import Rig, Session
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics, Pictures
from viewsep.sim.source import open_renderer
from viewsep.sim.stage import NEVER_S, Stage, Staging
from viewsep.sim.staged_camera import Delivery, StagedCamera
from viewsep.sim.world import SimWorld

STAGING = Staging(size=(320, 240), object_px=140, shadow=0.3, seed=2)
OPTICS = CameraOptics(STAGING.object_px)
RADIUS_PX = 0.47 * STAGING.object_px
NOTHING_WRONG, PROMPT = Disturbances(), Delivery()
CONFIG = Config()
MOTORS_GONE, CAMERA_GONE = "the motors are gone: plug them in again", "the camera is gone: plug it in again"
M = TypeVar("M")


class Motors(SimMotion):
    """Motors that are unplugged at a moment: nothing of them answers any more."""

    def __init__(self, world: SimWorld, seed: int, gone_s: float) -> None:
        super().__init__(world, seed)
        self._clock, self._gone_s = world.clock, gone_s

    def _check(self) -> None:
        super()._check()
        if self._clock.now_ns() * 1e-9 >= self._gone_s:
            raise RigError(MOTORS_GONE)

    def close(self) -> None:
        """Raises RigError when they are gone, as real ones do."""
        gone = self._connected and self._clock.now_ns() * 1e-9 >= self._gone_s
        super().close()
        if gone:
            raise RigError(MOTORS_GONE)


class Camera(StagedCamera):
    """A camera that is unplugged at a moment."""

    gone_s = NEVER_S

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """As the V4L2 driver: raises CameraLost at once."""
        if self._scene.clock.now_ns() * 1e-9 >= self.gone_s:
            raise CameraLost(CAMERA_GONE)
        return super().read(newer_than_ns, timeout_s)


class Exchanged:
    """Pictures of one object, and from a moment on of another one."""

    def __init__(self, first: Pictures, second: Pictures, clock: SimClock, at_s: float) -> None:
        self._first, self._second, self._clock, self._at_s = first, second, clock, at_s

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> tuple[Array, Array]:
        """The one that is there now."""
        now = self._second if self._clock.now_ns() * 1e-9 >= self._at_s else self._first
        return now.render(camera_direction, rotation)

    def close(self) -> None:
        """Both."""
        self._first.close()
        self._second.close()


@dataclass(frozen=True)
class Scenario:
    """What is on the rig (nothing where `source` is empty) and what goes wrong, in seconds of the rig's clock."""

    source: str
    seed: int = 1
    preset: str = "gimbal"
    staging: Staging = STAGING
    disturbances: Disturbances = NOTHING_WRONG
    delivery: Delivery = PROMPT
    motors_gone_s: float = NEVER_S
    camera_gone_s: float = NEVER_S
    exchanged_for: str = ""
    exchanged_s: float = NEVER_S

    def rig(self) -> Rig:
        """Where the scenario begins; devices are not connected."""
        clock = SimClock()
        world = SimWorld(preset(self.preset), clock, self.seed, self.disturbances)
        pictures: Pictures | None = open_renderer(self.source, OPTICS) if self.source else None
        if self.exchanged_for:
            assert pictures is not None
            pictures = Exchanged(pictures, open_renderer(self.exchanged_for, OPTICS), clock, self.exchanged_s)
        stage = Stage(self.staging)
        camera = Camera(world, pictures, stage, lambda stamp: world.load_at(stamp).tolist(), self.delivery)
        camera.gone_s = self.camera_gone_s
        return Rig(Motors(world, self.seed, self.motors_gone_s), camera, world.geometry, clock)


@cache
def background(rig_preset: str) -> BackgroundModel:
    """Of the empty rig, in front of which nothing else turns."""
    rig = Scenario("", preset=rig_preset).rig()
    rig.motion.connect()
    rig.camera.connect()
    model = learn_background(list(captured(rig, [rig.geometry.home()] * 4)))
    rig.motion.close()
    rig.camera.close()
    return model


def perception_of(rig: Rig, rig_preset: str = "gimbal") -> RigPerception:
    """What finds the object before the background."""
    ground = Segmenter(Background(background(rig_preset)))
    finder = ObjectFinder(ground, CONFIG.camera.size_px, RADIUS_PX)
    return RigPerception(rig, make_descriptor(CONFIG.descriptor), finder)


@dataclass(frozen=True)
class Told:
    """What came of a task: its result, and all that was recorded."""

    result: Result
    recording: Recording

    @property
    def messages(self) -> Sequence[Message]:
        """All that was recorded, in order."""
        return [recorded.message for recorded in self.recording.messages]

    def of(self, kind: type[M]) -> list[M]:
        """All of one type, in order."""
        return [message for message in self.messages if isinstance(message, kind)]


def task_on(scenario: Scenario, models: list[AspectGraph], record: Path) -> Told:
    """Run a task, record it, and replay the recording byte for byte."""
    rig = scenario.rig()
    session = Session(rig, make_engine(CONFIG, models), perception_of(rig, scenario.preset), pace_of(CONFIG))
    with task_recorder(record, CONFIG, models, scenario.seed, "") as recorder:
        session.listeners = (recorder,)
        with session:
            result = session.run(scenario.seed)
    recording = read_recording(record)
    assert verify(recording).exact
    return Told(result, recording)
