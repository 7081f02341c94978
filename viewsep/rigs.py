"""From configuration to a rig that a session can run on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from viewsep.cameras import optics_of, real_camera, simulated_camera
from viewsep.clock import MonotonicClock
from viewsep.config import Config, JointConfig, RigConfig, SimConfig, geometry_of
from viewsep.errors import BadConfig, BadInput
from viewsep.geometry import nearest_points
from viewsep.interfaces import MotionBackend
from viewsep.kinematics import PRESET_SPEED_DEG_S as SPEED
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph
from viewsep.servo_rig import is_emulated, joint_motion, servo_motion
from viewsep.session import Pace, Rig
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.followed import FollowedJoints, JointsAt
from viewsep.sim.motion import SimMotion
from viewsep.sim.plate import PhotoPlate, Photos
from viewsep.sim.render import Pictures
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import open_renderer
from viewsep.sim.view_set import SAME_VIEW_RAD, ViewSet, is_view_set, read_view_set
from viewsep.sim.world import Scene, SimWorld, standing

FEWEST_VIEWS = 3  # that a photo rig can work with


class PictureKind(StrEnum):
    """What the camera of a rig shows."""

    RENDERED = "rendered"
    STAGED = "staged"
    CAMERA = "a real camera's"
    PHOTOS = "photos"
    LEARNED_PHOTOS = "photos the model was learned from"


@dataclass(frozen=True, slots=True)
class BuiltRig:
    """A rig, what its pictures are, and the configuration that goes with it: the given one, with the views filled in
    where they are photos.
    """

    rig: Rig
    config: Config
    pictures: PictureKind

    @property
    def speed(self) -> float:
        """Seconds of the rig's clock per second; 0: time passes only when somebody waits."""
        clock = self.rig.clock
        if isinstance(clock, SimClock):
            return clock.speed if isinstance(clock, PacedClock) else 0.0
        return 1.0

    @property
    def described(self) -> str:
        """What moves and what sees."""
        moves = "simulated rig"
        if self.config.rig.backend == "dynamixel":
            moves = "emulated servos" if is_emulated(self.config) else f"servos on {self.config.dynamixel.port}"
        match self.pictures:
            case PictureKind.CAMERA:
                return f"{moves}, camera {self.config.v4l2.device}"
            case PictureKind.STAGED:
                return f"{moves}, staged camera"
            case PictureKind.RENDERED:
                return moves if moves == "simulated rig" else f"{moves}, simulated camera"
        return f"{moves}, {self.pictures}"


@dataclass(frozen=True, slots=True)
class SimulatedRig(BuiltRig):
    """A rig whose truth is known: the scene, and the digest of what is in its holder (empty: nothing is)."""

    scene: Scene
    object_digest: str

    def true_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        return self.scene.grasp_at(stamp_ns)


def rig_for(
    config: Config,
    source: str,
    seed: int,
    *,
    models: Sequence[AspectGraph] | None = None,
    cache: RenderCache | None = None,
    speed: float = 0.0,
) -> BuiltRig:
    """The rig of the configuration: with a real camera whatever is in its holder, otherwise holding `source`.

    Photos are shown only where `models` says what was learned from them. Raises BadInput.
    """
    check_held(config, source)
    if is_real(config):
        return real_rig(config)
    if models is None:
        return simulated_rig(config, source, seed, cache, speed=speed)
    return rig_holding(source, models, config, seed, cache, speed=speed)


def is_real(config: Config) -> bool:
    """Whether a camera sees what really is in the holder."""
    return config.camera.source == "v4l2"


def check_held(config: Config, source: str) -> None:
    """Raises BadInput when it is not said what a simulated camera sees, or when it is said of a real one."""
    if is_real(config) and source:
        raise BadInput(f"camera.source = 'v4l2' sees what is in the holder: leave {source!r} out, and put it there")
    if not is_real(config) and not source:
        raise BadInput("the camera is simulated: say what it sees with --object SOURCE")


def real_rig(config: Config) -> BuiltRig:
    """Servos and a camera, with whatever is in the holder. Raises BadConfig."""
    clock = MonotonicClock()  # the camera's stamps are of no other
    rig = Rig(joint_motion(config, clock), real_camera(config), geometry_of(config.rig), clock)
    return BuiltRig(rig, config, PictureKind.CAMERA)


def empty_rig(config: Config, seed: int) -> BuiltRig:
    """The rig with nothing in its holder; of one with a real camera that is up to whoever empties it.

    Raises BadConfig where pictures come with masks.
    """
    if is_real(config):
        return real_rig(config)
    if config.camera.source == "simulated" or config.rig.backend == "photos":
        raise BadConfig(
            "camera.source = 'simulated' gives masks and shows no background: there is nothing to capture; use "
            "'staged' or 'v4l2'"
        )
    return _simulated(config, None, "", seed, 0.0)


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
    renderer = open_renderer(source, optics_of(config), cache)
    return _simulated(config, renderer, renderer.mesh.digest, seed, speed)


def _simulated(config: Config, pictures: Pictures | None, digest: str, seed: int, speed: float) -> SimulatedRig:
    """The rig with a simulated camera, holding what the pictures are of."""
    geometry, disturbances = geometry_of(config.rig), disturbances_of(config.sim)
    grasp = standing(geometry, seed) if config.sim.placed == "standing" else None
    motion: MotionBackend
    scene: Scene
    joints_at: JointsAt
    if config.rig.backend == "dynamixel":
        motion, clock, joints_at = servo_motion(config)
        scene = FollowedJoints(geometry, clock, seed, disturbances, joints_at, grasp)
    else:
        clock = _clock(speed)
        scene = world = SimWorld(geometry, clock, seed, disturbances, grasp)
        motion = SimMotion(world, seed)

        def joints_at(stamp_ns: int) -> Sequence[float]:
            angles: list[float] = world.load_at(stamp_ns).tolist()
            return angles

    camera = simulated_camera(config, scene, pictures, joints_at, seed)
    kind = PictureKind.STAGED if config.camera.source == "staged" else PictureKind.RENDERED
    return SimulatedRig(Rig(motion, camera, geometry, clock), config, kind, scene, digest)


def disturbances_of(sim: SimConfig) -> Disturbances:
    """What goes wrong on a simulated rig."""
    return Disturbances(**sim.model_dump(exclude={"placed"}))


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
    if config.camera.source != "simulated":
        raise BadConfig(
            f"camera.source = {config.camera.source!r}, but photos as those in {view_set.folder} are all that is seen: "
            "leave the key out, or hold a mesh"
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
    disturbances = disturbances_of(config.sim)
    plate = PhotoPlate(geometry, clock, disturbances, np.radians(joints_deg), turn)
    photos = Photos(view_set, shown, config.camera.size_px)
    camera = SimCamera(plate, photos, config.camera.rate_hz, seed)
    rig = Rig(SimMotion(plate, seed), camera, geometry, clock)
    return SimulatedRig(rig, config, pictures, plate, view_set.digest)


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
