"""The configuration tables about pictures: which camera, what it sees, and how the object is found in that."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from viewsep.config_section import Section
from viewsep.errors import BadConfig


class CameraConfig(Section):
    """Picture size (square), exposure rate, and how much later than the exposure its stamps are.

    `source` "simulated" sees the object alone, with a mask; "staged" sees it in surroundings (`[stage]`), and "v4l2" is
    a real camera (`[v4l2]`): neither gives a mask, so `[perception]` has to find the object.
    """

    source: Literal["simulated", "staged", "v4l2"] = "simulated"
    size_px: int = Field(default=128, ge=32, le=1024)
    rate_hz: float = Field(default=30.0, gt=0, le=1000)
    latency_s: float = Field(default=0.0, ge=-0.5, le=0.5)


class MaskLimits(Section):
    """Where a mask stops being good; see docs/perception.md. Shares are of the picture or of the object's outline."""

    smallest_share: float = Field(default=0.003, gt=0, lt=1)
    largest_share: float = Field(default=0.6, gt=0, le=1)
    border_share: float = Field(default=0.01, gt=0, le=1)
    area_jump: float = Field(default=1.35, gt=1, le=100)
    contrast_share: float = Field(default=0.6, gt=0, le=1)
    rival_share: float = Field(default=0.12, gt=0, le=1)


class PerceptionConfig(Section):
    """How the object is found in frames that come without a mask: `given` leaves that to the camera.

    `background` and `holder` are files that were captured of the empty rig (a holder that does not move may be a PNG,
    white where it is), `region` columns and rows left, top, width, height. `object_radius_px` is the radius of the
    object's bounding sphere in the camera's picture, 0: the largest seen so far.
    """

    method: Literal["given", "background", "plain", "region"] = "given"
    background: str = ""
    holder: str = ""
    region: tuple[int, int, int, int] | None = None
    object_radius_px: float = Field(default=0.0, ge=0, le=10_000)
    limits: MaskLimits = MaskLimits()


class V4l2Config(Section):
    """A real camera; see docs/camera.md. `device` is best a path below /dev/v4l/by-id, which follows the camera.

    What is left out stays as the camera has it. `exposure_ms` goes in steps of 0.1 ms, `white_balance_k` is in kelvin,
    `gain` and `focus` are in the camera's own units. A camera that sends nothing for `stall_s` is opened anew.
    """

    device: str = ""
    format: Literal["MJPG", "YUYV"] = "MJPG"
    width_px: int = Field(default=640, ge=16, le=8192)
    height_px: int = Field(default=480, ge=16, le=8192)
    rate_hz: int = Field(default=30, ge=1, le=1000)
    exposure_ms: float | None = Field(default=None, ge=0.1, le=60_000)
    white_balance_k: int | None = Field(default=None, ge=1000, le=20_000)
    gain: int | None = Field(default=None, ge=-(2**31), lt=2**31)
    focus: int | None = Field(default=None, ge=-(2**31), lt=2**31)
    stamps: Literal["kernel", "arrival"] = "kernel"
    stall_s: float = Field(default=3.0, ge=1, le=60)


class StageConfig(Section):
    """What a staged camera sees beside the object, and what goes wrong in its pictures; see docs/perception.md.

    `plate` and `gripper` turn with the last joint; left out, there is a plate where that is the only joint. `object_px`
    is how wide the square is that the object's render takes. Desk and plate follow from `seed`; light, noise and losses
    from the rig's seed as well.
    """

    background: Literal["desk", "plain"] = "desk"
    plate: bool | None = None
    gripper: bool = False
    width_px: int = Field(default=640, ge=64, le=4096)
    height_px: int = Field(default=480, ge=64, le=4096)
    object_px: int = Field(default=280, ge=32, le=2048)
    shadow: float = Field(default=0.45, ge=0, le=1)
    exposure_drift: float = Field(default=0.08, ge=0, lt=1)
    drift_period_s: float = Field(default=20.0, gt=0, le=3600)
    exposure_offset: float = Field(default=0.1, ge=0, lt=1)
    colour_drift: float = Field(default=0.02, ge=0, lt=1)
    noise: float = Field(default=2.0, ge=0, le=100)
    shake_px: float = Field(default=0.7, ge=0, le=50)
    latency_s: float = Field(default=0.03, ge=0, le=5)
    drop_rate: float = Field(default=0.0, ge=0, lt=1)
    seed: int = Field(default=0, ge=0, le=2**62)


def check_perception(given: PerceptionConfig) -> None:
    """Raises BadConfig when the method lacks what it needs."""
    if given.method == "background" and not given.background:
        raise BadConfig(
            "key 'perception.background' is missing: give the file captured of the empty rig, or use method 'plain'"
        )
    if given.method == "region" and given.region is None:
        raise BadConfig("key 'perception.region' is missing: give [left, top, width, height] in pixels")
    if given.region is not None and (min(given.region[:2]) < 0 or min(given.region[2:]) < 1):
        raise BadConfig(
            f"key 'perception.region' = {list(given.region)}: left and top must be at least 0, width and height 1"
        )
