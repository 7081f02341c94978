"""A simulated rig before a camera that gives no masks, where things go wrong; tasks on it are recorded and replayed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.kinematics import preset
from viewsep.messages import Message, Result
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.perception.background import Background, BackgroundModel, learn_background
from viewsep.perception.empty_rig import captured
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.plugins import make_descriptor
from viewsep.recording import task_recorder
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.rigs import pace_of
from viewsep.session import Rig, Session
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import Delivery, StagedCamera
from viewsep.sim.world import SimWorld

M = TypeVar("M")
STAGING = Staging(size=(320, 240), object_px=140, shadow=0.3, seed=2)


def staged_rig(
    source: str, staging: Staging, disturbances: Disturbances, delivery: Delivery, seed: int, rig_preset: str = "gimbal"
) -> Rig:
    """A rig that holds the object; none where `source` is empty."""
    clock = SimClock()
    world = SimWorld(preset(rig_preset), clock, seed, disturbances)
    shown = open_renderer(source, CameraOptics(STAGING.object_px)) if source else None
    camera = StagedCamera(world, shown, Stage(staging), lambda stamp: world.load_at(stamp).tolist(), delivery)
    return Rig(SimMotion(world, seed), camera, world.geometry, clock)


@cache
def background(rig_preset: str = "gimbal") -> BackgroundModel:
    rig = staged_rig("", STAGING, Disturbances(), Delivery(), 1, rig_preset)
    rig.motion.connect()
    rig.camera.connect()
    home = rig.geometry.home()
    model = learn_background(list(captured(rig, [home] * 4)))
    rig.motion.close()
    rig.camera.close()
    return model


def finder(rig_preset: str = "gimbal") -> ObjectFinder:
    return ObjectFinder(Segmenter(Background(background(rig_preset))), Config().camera.size_px, 0.47 * 140)


@dataclass(frozen=True)
class Told:
    """What came of a task: its result, and all that was recorded."""

    result: Result
    messages: Sequence[Message]

    def of(self, kind: type[M]) -> list[M]:
        return [message for message in self.messages if isinstance(message, kind)]


def task_on(rig: Rig, models: list[AspectGraph], record: Path, config: Config, seed: int) -> Told:
    """Run a task, record it, and replay the recording byte for byte."""
    perception = RigPerception(rig, make_descriptor(config.descriptor), finder())
    with (
        task_recorder(record, config, models, seed, "") as recorder,
        Session(rig, make_engine(config, models), perception, pace_of(config), [recorder]) as session,
    ):
        result = session.run(seed)
    recording = read_recording(record)
    assert verify(recording).exact
    return Told(result, [recorded.message for recorded in recording.messages])
