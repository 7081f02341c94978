"""A simulated rig whose pictures are photos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.built_rig import PictureKind, SimulatedRig, clock_at, disturbances_of
from viewsep.config import Config, JointConfig, RigConfig, geometry_of
from viewsep.errors import BadConfig, BadInput
from viewsep.geometry import nearest_points
from viewsep.kinematics import PRESET_SPEED_DEG_S as SPEED
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph
from viewsep.session import Rig
from viewsep.sim.camera import SimCamera
from viewsep.sim.motion import SimMotion
from viewsep.sim.plate import PhotoPlate, Photos
from viewsep.sim.view_set import SAME_VIEW_RAD, ViewSet

FEWEST_VIEWS = 3  # that a photo rig can work with


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
    geometry, clock = geometry_of(config.rig), clock_at(speed)
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
