"""The configuration file: TOML, angles in degrees, every key checked. `docs/config` has an example for each rig."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from viewsep.camera_config import CameraConfig, PerceptionConfig, StageConfig, V4l2Config, check_perception
from viewsep.config_section import Section
from viewsep.errors import BadConfig
from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, RigGeometry, preset, rig_geometry


class JointConfig(Section):
    """One revolute joint of a rig that is not a preset. Without limits it turns freely."""

    name: str = Field(min_length=1)
    axis: tuple[float, float, float]
    lower_deg: float | None = None
    upper_deg: float | None = None
    max_speed_deg_s: float = Field(default=60.0, gt=0, le=720)


class RigConfig(Section):
    """Which joints hold the object and where the camera is: a preset (`gimbal` by default) or `joints`.

    `camera_elevation_deg` overrides the preset's; own joints have 0 by default. `backlash_deg` is the play between
    encoder and object, one number for each joint in their order; `viewsep rig calibrate camera` finds it.
    `views_deg` are the only views that a rig with photos shows, azimuth and elevation in the control frame; they
    follow from the photos and are filled in.
    """

    backend: Literal["sim", "photos", "dynamixel"] = "sim"
    preset: str | None = None
    joints: tuple[JointConfig, ...] = ()
    camera_elevation_deg: float | None = Field(default=None, ge=-90, le=90)
    backlash_deg: tuple[Annotated[float, Field(ge=0, le=45)], ...] = ()
    views_deg: tuple[tuple[float, Annotated[float, Field(ge=-90, le=90)]], ...] = ()


class ServoConfig(Section):
    """The servo that turns one joint; see docs/hardware.md. Limits that are left out are the servo's own.

    `zero_counts` is its position when the joint is at zero. `effort_limit` is in A where the model measures current,
    otherwise a share of full load.
    """

    joint: str = Field(min_length=1)
    id: int = Field(ge=0, le=252)
    model: str = ""
    mode: Literal["position", "extended"] = "position"
    zero_counts: int = Field(default=2048, ge=-1_048_575, le=1_048_575)
    direction: Literal[1, -1] = 1
    gear_ratio: float = Field(default=1.0, gt=0, le=1000)
    acceleration_deg_s2: float = Field(default=300.0, gt=0, le=100_000)
    effort_limit: float | None = Field(default=None, gt=0)
    temperature_limit_c: float | None = Field(default=None, gt=0, le=100)
    min_voltage_v: float | None = Field(default=None, gt=0, le=60)
    max_voltage_v: float | None = Field(default=None, gt=0, le=60)


class DynamixelConfig(Section):
    """A bus of servos, `[[dynamixel.servos]]` one for each joint of the rig. `port` "emulated" needs no hardware.

    A servo that hears nothing for `watchdog_s` stops by itself (0: never); one that does not answer for `lost_s` is
    lost. `emulated_speed` is how fast the time of emulated servos passes.
    """

    port: str = ""
    baud: Literal[9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000] = 57600
    state_hz: float = Field(default=100.0, ge=10, le=1000)
    retries: int = Field(default=3, ge=0, le=20)
    watchdog_s: float = Field(default=0.5, ge=0, le=2.54)
    when_stopped: Literal["hold", "release"] = "hold"
    settle_within_deg: float = Field(default=0.5, gt=0, le=10)
    lost_s: float = Field(default=0.5, gt=0, le=10)
    emulated_speed: float = Field(default=1.0, gt=0, le=20)
    servos: tuple[ServoConfig, ...] = ()


class PluginConfig(Section):
    """A plug-in by name, with its own options."""

    name: str = Field(min_length=1)
    options: dict[str, Any] = Field(default_factory=dict)


class DescriptorConfig(PluginConfig):
    """The feature of a view."""

    name: str = Field(default="opponent+rings", min_length=1)


class InterpreterConfig(PluginConfig):
    """The method that turns percepts into poses and ratings."""

    name: str = Field(default="filter", min_length=1)


class PlannerConfig(PluginConfig):
    """The method that chooses the next view."""

    name: str = Field(default="information", min_length=1)


class TaskConfig(Section):
    """Budgets of a task. `looks_per_s` is the rate of the interpretation module (the seed: 3 to 5).

    With `pose_tolerance_deg` a named object's pose must be known that well, too, before the task ends; only an
    interpreter with probabilities knows how well. With `look_around` no name is given before that share of what the rig
    can show has been seen, since an object that was not learned may be like a candidate from the other sides.
    """

    max_looks: int = Field(default=400, ge=1)
    max_failed_moves: int = Field(default=3, ge=1)
    max_missing_frames: int = Field(default=20, ge=1)
    look_every_deg: float = Field(default=4.0, ge=0, le=45)
    confirming_looks: int = Field(default=3, ge=1)
    judge_within_deg: float = Field(default=20.0, ge=0, le=180)
    pose_tolerance_deg: float | None = Field(default=None, gt=0, le=180)
    look_around: float = Field(default=0.0, ge=0, le=1)
    looks_per_s: float = Field(default=4.0, gt=0, le=100)
    frame_timeout_s: float = Field(default=1.0, gt=0)
    move_timeout_s: float = Field(default=15.0, gt=0)
    deadline_s: float = Field(default=600.0, gt=0)


class SimConfig(Section):
    """Disturbances of the simulated rig; 0 is off. `placed` is how its object is put in: in any rotation, or upright on
    what the last joint turns (the mesh's z axis along the joint's), at an unknown angle.
    """

    placed: Literal["anyhow", "standing"] = "anyhow"
    light: float = Field(default=0.0, ge=0, le=1)
    light_offset: float = Field(default=0.0, ge=0, lt=1)
    white_balance: float = Field(default=0.0, ge=0, lt=1)
    noise: float = Field(default=0.0, ge=0, le=1)
    blur_px: float = Field(default=0.0, ge=0, le=50)
    mask_error: float = Field(default=0.0, ge=0, le=1)
    backlash_deg: float = Field(default=0.0, ge=0, le=45)
    encoder_noise_deg: float = Field(default=0.0, ge=0, le=45)
    latency_s: float = Field(default=0.0, ge=0, le=5)
    drop_rate: float = Field(default=0.0, ge=0, lt=1)
    slip_deg: float = Field(default=0.0, ge=0, le=180)
    slip_after_s: float = Field(default=5.0, ge=0)


class ServiceConfig(Section):
    """How the rig is served on Zenoh; see docs/deploy.md. `listen_images` and `connect_images` carry pictures only.

    `name` is the rig's in every key. `keys` is the folder of certificates and `certificate` the one to use; without
    keys only loopback addresses are allowed. A role that runs apart from the rig reaches it through `connect`; a
    router is reached through `connect`, and given the pictures through `connect_images`.
    """

    name: str = Field(default="bench", pattern=r"^[A-Za-z0-9_.-]{1,64}$")
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    listen_images: tuple[str, ...] = ("tcp/127.0.0.1:7448",)
    connect: tuple[str, ...] = ()
    connect_images: tuple[str, ...] = ()
    keys: str = ""
    certificate: str = "rig"
    library: str = "library"
    recordings: str = "recordings"
    record: bool = True
    holds: str = Field(default="generated:7", min_length=1)
    seed: int = Field(default=0, ge=0, le=2**62)
    speed: float = Field(default=1.0, ge=0, le=100)
    send: Literal["image", "crop", "descriptor"] = "descriptor"
    lease_s: float = Field(default=2.0, ge=0.2, le=60)
    resume_s: float = Field(default=10.0, ge=0, le=3600)


class RecordingConfig(Section):
    """How recordings are kept safe. A file is written to the disk every `sync_s`; a new one begins after `rotate_mb`
    or `rotate_s` (0: never); recording ends in good order when less than `min_free_mb` of the disk are left. The
    engine's state is kept every `keyframe_s` (0: never); pictures wait to be written in at most `queue_mb`.
    """

    sync_s: float = Field(default=0.5, ge=0.05, le=60)
    rotate_mb: float = Field(default=1024.0, ge=0, le=1_000_000)
    rotate_s: float = Field(default=0.0, ge=0, le=1_000_000)
    min_free_mb: float = Field(default=200.0, ge=0, le=1_000_000)
    keyframe_s: float = Field(default=5.0, ge=0, le=3600)
    queue_mb: float = Field(default=64.0, ge=1, le=16_000)


class Config(Section):
    """Everything that decides how viewsep behaves, apart from the seed and the models."""

    rig: RigConfig = RigConfig()
    camera: CameraConfig = CameraConfig()
    perception: PerceptionConfig = PerceptionConfig()
    descriptor: DescriptorConfig = DescriptorConfig()
    interpreter: InterpreterConfig = InterpreterConfig()
    planner: PlannerConfig = PlannerConfig()
    task: TaskConfig = TaskConfig()
    sim: SimConfig = SimConfig()
    service: ServiceConfig = ServiceConfig()
    dynamixel: DynamixelConfig = DynamixelConfig()
    recording: RecordingConfig = RecordingConfig()
    v4l2: V4l2Config = V4l2Config()
    stage: StageConfig = StageConfig()


def load_config(path: Path) -> Config:
    """Read a configuration file. Raises BadConfig naming file, key, value and remedy."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadConfig(f"cannot read the configuration {path}: {error}") from error
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadConfig(f"{path} is not TOML: {error}") from error
    return parse_config(table, str(path))


def parse_config(table: Any, origin: str) -> Config:
    """Check a configuration given as nested dicts. Raises BadConfig; `origin` names it there."""
    try:
        config = Config.model_validate(table)
    except ValidationError as error:
        raise BadConfig(f"{origin}: {explain(error)}") from error
    rig = config.rig
    if rig.preset is not None and rig.preset not in PRESETS:
        raise BadConfig(
            f"{origin}: key 'rig.preset' = {rig.preset!r}: choose one of {', '.join(PRESETS)}, or give rig.joints"
        )
    if rig.joints and rig.preset is not None:
        raise BadConfig(f"{origin}: keys 'rig.preset' and 'rig.joints' exclude each other: remove one")
    if rig.views_deg and rig.backend != "photos":
        raise BadConfig(
            f"{origin}: key 'rig.views_deg' goes with rig.backend = 'photos', not {rig.backend!r}: remove it"
        )
    try:
        check_perception(config.perception)
        _check_camera(config)
        _check_backlash(rig)
        if rig.backend == "dynamixel":
            _check_servos(config)
    except BadConfig as error:
        raise BadConfig(f"{origin}: {error}") from error
    return config


def explain(error: ValidationError) -> str:
    """The first complaint of pydantic as one sentence: key, value, reason."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"unknown key {key!r}: check the spelling against the examples in docs/config"
    return f"key {key!r} = {first['input']!r}: {first['msg'][0].lower()}{first['msg'][1:]}"


def _check_camera(config: Config) -> None:
    """Raises BadConfig when the camera does not go with the rig, or nothing finds the object in its pictures."""
    source = config.camera.source
    if source == "simulated":
        return
    said = f"key 'camera.source' = {source!r}"
    if config.perception.method == "given":
        raise BadConfig(
            f"{said}: no mask comes with its pictures, but perception.method = 'given': use 'background', 'plain' or "
            "'region' (docs/perception.md)"
        )
    if config.rig.backend == "photos":
        raise BadConfig(f"{said}: a rig over photos shows those: leave the key out, or hold a mesh")
    if source == "v4l2":
        _check_real_camera(config, said)
        return
    for key in ("light", "light_offset", "white_balance", "noise", "blur_px", "mask_error", "latency_s", "drop_rate"):
        if getattr(config.sim, key):
            raise BadConfig(
                f"key 'sim.{key}' = {getattr(config.sim, key):g} goes with camera.source = 'simulated': what goes "
                "wrong in the pictures of a staged camera is in [stage]"
            )


def _check_real_camera(config: Config, said: str) -> None:
    """Raises BadConfig where nothing real turns before it."""
    if config.rig.backend != "dynamixel":
        raise BadConfig(
            f"{said}: it sees nothing of a simulated rig: set rig.backend = 'dynamixel' (docs/hardware.md), or source "
            "'simulated' or 'staged'"
        )
    if config.dynamixel.emulated_speed != 1.0:
        raise BadConfig(
            f"key 'dynamixel.emulated_speed' = {config.dynamixel.emulated_speed:g}: a real camera knows no other time "
            "than the clock's: remove the key"
        )


def _check_backlash(rig: RigConfig) -> None:
    """Raises BadConfig when there is not one number for each joint."""
    names = [joint.name for joint in geometry_of(rig).limits]
    if rig.backlash_deg and len(rig.backlash_deg) != len(names):
        raise BadConfig(
            f"key 'rig.backlash_deg' has {len(rig.backlash_deg)} numbers, but the rig has the joints {names}: give one "
            "for each, in this order"
        )


def _check_servos(config: Config) -> None:
    """Raises BadConfig when the servos are not those of the rig's joints."""
    given, names = config.dynamixel, [joint.name for joint in geometry_of(config.rig).limits]
    if not given.port:
        raise BadConfig(
            "key 'dynamixel.port' is missing: give the servos' serial port (`viewsep rig ports` lists them), or "
            "'emulated'"
        )
    if [servo.joint for servo in given.servos] != names:
        raise BadConfig(
            f"key 'dynamixel.servos' is for the joints {[servo.joint for servo in given.servos]}, but the rig has "
            f"{names}: give one [[dynamixel.servos]] for each, in this order"
        )


@lru_cache(maxsize=8)
def geometry_of(rig: RigConfig) -> RigGeometry:
    """The rig's axes, limits and camera, the same object for equal rigs. Raises BadConfig."""
    if not rig.joints:
        return preset(rig.preset or "gimbal", rig.camera_elevation_deg)
    limits = [
        JointLimits(
            joint.name,
            -np.inf if joint.lower_deg is None else np.radians(joint.lower_deg),
            np.inf if joint.upper_deg is None else np.radians(joint.upper_deg),
            np.radians(joint.max_speed_deg_s),
        )
        for joint in rig.joints
    ]
    return rig_geometry("custom", [joint.axis for joint in rig.joints], limits, rig.camera_elevation_deg or 0.0)
