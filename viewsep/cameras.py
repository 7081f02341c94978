"""From the configuration to a camera."""

from __future__ import annotations

from viewsep.clock import MonotonicClock
from viewsep.config import Config, geometry_of
from viewsep.drivers.v4l2.camera import V4l2Camera
from viewsep.drivers.v4l2.system import THIS_MACHINE
from viewsep.interfaces import CameraSource
from viewsep.sim.camera import SimCamera
from viewsep.sim.followed import JointsAt
from viewsep.sim.render import CameraOptics, Pictures
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import Delivery, StagedCamera
from viewsep.sim.world import Scene
from viewsep.v4l2_camera import v4l2_settings

NOT_STAGING = {"plate", "width_px", "height_px", "latency_s", "drop_rate"}  # keys of [stage] that are named otherwise


def optics_of(config: Config) -> CameraOptics:
    """How the object alone is rendered for the camera."""
    return CameraOptics(config.stage.object_px if config.camera.source == "staged" else config.camera.size_px)


def simulated_camera(
    config: Config, scene: Scene, pictures: Pictures | None, joints_at: JointsAt, seed: int
) -> CameraSource:
    """What looks at a scene: at the object alone, with a mask, or on its stage. `pictures` None is an empty stage."""
    if config.camera.source == "staged":
        return StagedCamera(scene, pictures, Stage(staging_of(config, seed)), joints_at, _delivery(config))
    assert pictures is not None
    return SimCamera(scene, pictures, config.camera.rate_hz, seed)


def real_camera(config: Config) -> V4l2Camera:
    """The camera of `[v4l2]`, not opened yet. Raises BadConfig."""
    return V4l2Camera(v4l2_settings(config.v4l2, "the configuration"), MonotonicClock(), THIS_MACHINE)


def staging_of(config: Config, seed: int) -> Staging:
    """The scene of `[stage]`, exposed as on the occasion that `seed` stands for."""
    stage = config.stage
    plate = len(geometry_of(config.rig).limits) == 1 if stage.plate is None else stage.plate
    given = stage.model_dump(exclude=NOT_STAGING)
    return Staging(plate=plate, size=(stage.width_px, stage.height_px), occasion=(seed,), **given)


def _delivery(config: Config) -> Delivery:
    return Delivery(config.camera.rate_hz, config.stage.latency_s, config.stage.drop_rate)
