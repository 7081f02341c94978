"""From configuration to a rig that a session can run on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from viewsep.built_rig import BuiltRig, PictureKind, SimulatedRig, clock_at, disturbances_of
from viewsep.cameras import optics_of, real_camera, simulated_camera
from viewsep.clock import MonotonicClock
from viewsep.config import Config, geometry_of
from viewsep.errors import BadConfig, BadInput
from viewsep.interfaces import MotionBackend
from viewsep.models.aspect_graph import AspectGraph
from viewsep.photo_rig import held_out, photo_rig
from viewsep.servo_rig import joint_motion, servo_motion
from viewsep.session import Pace, Rig
from viewsep.sim.followed import FollowedJoints, JointsAt
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import Pictures
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import open_renderer
from viewsep.sim.view_set import is_view_set, read_view_set
from viewsep.sim.world import Scene, SimWorld, standing


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
        clock = clock_at(speed)
        scene = world = SimWorld(geometry, clock, seed, disturbances, grasp)
        motion = SimMotion(world, seed)

        def joints_at(stamp_ns: int) -> Sequence[float]:
            angles: list[float] = world.load_at(stamp_ns).tolist()
            return angles

    camera = simulated_camera(config, scene, pictures, joints_at, seed)
    kind = PictureKind.STAGED if config.camera.source == "staged" else PictureKind.RENDERED
    return SimulatedRig(Rig(motion, camera, geometry, clock), config, kind, scene, digest)


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
