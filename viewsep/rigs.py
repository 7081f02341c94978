"""From configuration to a rig that a session can run on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from viewsep.config import Config, JointConfig, RigConfig, geometry_of
from viewsep.errors import BadConfig, BadInput
from viewsep.geometry import nearest_points
from viewsep.interfaces import MotionBackend
from viewsep.kinematics import PRESET_SPEED_DEG_S as SPEED
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph
from viewsep.servo_rig import is_emulated, servo_motion
from viewsep.session import Pace, Rig
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.followed import FollowedJoints
from viewsep.sim.motion import SimMotion
from viewsep.sim.plate import PhotoPlate, Photos
from viewsep.sim.render import CameraOptics
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import open_renderer
from viewsep.sim.view_set import SAME_VIEW_RAD, ViewSet, is_view_set, read_view_set
from viewsep.sim.world import Scene, SimWorld

FEWEST_VIEWS = 3  # that a photo rig can work with


class PictureKind(StrEnum):
    """What the camera of a simulated rig shows."""

    RENDERED = "rendered"
    PHOTOS = "photos"
    LEARNED_PHOTOS = "photos the model was learned from"


@dataclass(frozen=True, slots=True)
class SimulatedRig:
    """A rig whose truth is known: the scene, the digest of what is in its holder, and what its pictures are.

    `config` is the configuration that goes with it: the given one, with the views filled in where they are photos.
    """

    rig: Rig
    scene: Scene
    object_digest: str
    config: Config
    pictures: PictureKind

    @property
    def speed(self) -> float:
        """Seconds of the rig's clock per second; 0: time passes only when somebody waits."""
        clock = self.rig.clock
        return clock.speed if isinstance(clock, PacedClock) else 0.0

    @property
    def described(self) -> str:
        """What moves and what sees."""
        moves = "simulated rig"
        if self.config.rig.backend == "dynamixel":
            moves = "emulated servos" if is_emulated(self.config) else f"servos on {self.config.dynamixel.port}"
            moves += ", simulated camera"
        return moves if self.pictures is PictureKind.RENDERED else f"{moves}, {self.pictures}"

    def true_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        return self.scene.grasp_at(stamp_ns)


def rig_holding(
    source: str,
    models: Sequence[AspectGraph],
    config: Config,
    seed: int,
    cache: RenderCache | None = None,
    *,
    speed: float = 0.0,
) -> SimulatedRig:
    """The simulated rig that holds a mesh, a generated product, or an object of which there are photos.

    Of a candidate's photos it shows those that its model was not learned from, if there are any. Its time passes at
    `speed` times the wall's, or with 0 only when somebody waits. Raises BadInput.
    """
    if not is_view_set(Path(source)):
        return simulated_rig(config, source, seed, cache, speed=speed)
    view_set = read_view_set(Path(source))
    shown = held_out(view_set, models)
    if len(shown) > 0:
        return photo_rig(config, view_set, shown, seed, speed=speed)
    every = range(len(view_set.images))
    return photo_rig(config, view_set, every, seed, PictureKind.LEARNED_PHOTOS, speed=speed)


def simulated_rig(
    config: Config, source: str, seed: int, cache: RenderCache | None = None, *, speed: float = 0.0
) -> SimulatedRig:
    """The simulated rig holding a mesh in an unknown grasp drawn from the seed. Raises BadInput, BadMesh.

    With servos, real or emulated, the camera alone is simulated, and time passes as it does for them.
    """
    if config.rig.backend == "photos":
        raise BadConfig(f"rig.backend = 'photos', but {source} is not a folder with photos and views.csv: use 'sim'")
    geometry, disturbances = geometry_of(config.rig), Disturbances(**config.sim.model_dump())
    renderer = open_renderer(source, CameraOptics(config.camera.size_px), cache)
    motion: MotionBackend
    scene: Scene
    if config.rig.backend == "dynamixel":
        motion, clock, joints_at = servo_motion(config)
        scene = FollowedJoints(geometry, clock, seed, disturbances, joints_at)
    else:
        clock = _clock(speed)
        scene = world = SimWorld(geometry, clock, seed, disturbances)
        motion = SimMotion(world, seed)
    camera = SimCamera(scene, renderer, config.camera.rate_hz, seed)
    return SimulatedRig(Rig(motion, camera, geometry, clock), scene, renderer.mesh.digest, config, PictureKind.RENDERED)


def photo_rig(
    config: Config,
    view_set: ViewSet,
    shown: Sequence[int],
    seed: int,
    pictures: PictureKind = PictureKind.PHOTOS,
    *,
    speed: float = 0.0,
) -> SimulatedRig:
    """A simulated plate that shows the photos at `shown`, the object standing on it at an angle drawn from the seed.

    The plate clicks from view to view, so every picture belongs to the direction it is reported with. Raises BadInput
    for photos that cannot be used and for a configuration that they cannot follow.
    """
    if len(shown) < FEWEST_VIEWS:
        raise BadInput(
            f"{view_set.folder}: {len(shown)} photos are too few for a rig (at least {FEWEST_VIEWS}); leave more of "
            "them out of the model, e.g. with learn --every 4, or take more"
        )
    if config.rig.backend == "dynamixel":
        raise BadConfig(
            f"rig.backend = 'dynamixel', but photos as those in {view_set.folder} follow no servos: hold a mesh"
        )
    for key in ("backlash_deg", "slip_deg"):
        if getattr(config.sim, key):
            raise BadConfig(f"key 'sim.{key}' = {getattr(config.sim, key):g}: photos have no such disturbance: use 0")
    turn = float(np.random.default_rng([seed, 1]).uniform(0.0, 2.0 * np.pi))
    angles_deg = view_set.angles_deg[list(shown)] + [np.degrees(turn), 0.0]
    angles_deg[:, 0] %= 360.0
    config = config.model_copy(update={"rig": _rig_of(angles_deg, config.rig, str(view_set.folder))})
    geometry, clock = geometry_of(config.rig), _clock(speed)
    joints_deg = np.stack([angles_deg[:, 1], -angles_deg[:, 0]], axis=1)[:, -len(geometry.limits) :]  # tilt, pan
    disturbances = Disturbances(**config.sim.model_dump())
    plate = PhotoPlate(geometry, clock, disturbances, np.radians(joints_deg), turn)
    photos = Photos(view_set, shown, config.camera.size_px)
    camera = SimCamera(plate, photos, config.camera.rate_hz, seed)
    return SimulatedRig(Rig(SimMotion(plate, seed), camera, geometry, clock), plate, view_set.digest, config, pictures)


def held_out(view_set: ViewSet, models: Sequence[AspectGraph]) -> list[int]:
    """Indices of the photos that are no trials, and no nodes of any model that was learned from this view set."""
    free = ~view_set.trial
    for model in models:
        if model.provenance.source_digest == view_set.digest:
            free &= nearest_points(model.directions, view_set.directions)[0] > SAME_VIEW_RAD
    return [int(index) for index in np.flatnonzero(free)]


def _clock(speed: float) -> SimClock:
    return PacedClock(speed) if speed > 0.0 else SimClock()


def _rig_of(angles_deg: FloatArray, given: RigConfig, folder: str) -> RigConfig:
    """A turntable where all photos have one elevation, otherwise tilt and pan as a gimbal's, within what they show.

    Raises BadConfig when the given rig is set up as another one.
    """
    views_deg = tuple((float(azimuth), float(elevation)) for azimuth, elevation in angles_deg)
    lowest, highest = float(angles_deg[:, 1].min()), float(angles_deg[:, 1].max())
    if highest - lowest < np.degrees(SAME_VIEW_RAD):
        rig = RigConfig(backend="photos", preset="turntable", camera_elevation_deg=lowest, views_deg=views_deg)
    else:
        tilt = JointConfig(name="tilt", axis=(0, 1, 0), lower_deg=lowest, upper_deg=highest, max_speed_deg_s=SPEED)
        pan = JointConfig(name="pan", axis=(0, 0, 1), max_speed_deg_s=SPEED)
        rig = RigConfig(backend="photos", joints=(tilt, pan), views_deg=views_deg)
    for key in ("preset", "joints", "camera_elevation_deg", "views_deg"):
        if getattr(given, key) not in (None, (), getattr(rig, key)):
            raise BadConfig(
                f"key 'rig.{key}' is set, but the rig over the photos in {folder} follows from their directions: "
                "remove the key, or hold a mesh"
            )
    return rig


def pace_of(config: Config) -> Pace:
    """The loop's rates and deadlines."""
    task = config.task
    return Pace(
        1.0 / task.looks_per_s,
        task.frame_timeout_s,
        task.move_timeout_s,
        task.deadline_s,
        config.recording.keyframe_s,
    )
