"""What a service says of itself: the status, schema `viewsep.status/1`. Degrees and seconds; null where not known.

One process that serves both roles answers with both sections; two processes answer with one each, and whoever asks
puts them together with `merge`.
"""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from viewsep.account import Account
from viewsep.service.names import STATUS_SCHEMA


class Said(BaseModel):
    """A part of the status. Fields of a newer service that this one does not know are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class JointStatus(Said):
    """One joint; `temperature_c` is null where it is not measured."""

    name: str
    position_deg: float
    setpoint_deg: float
    temperature_c: float | None = None


class MotionStatus(Said):
    """The joints. `holder` says who may move them now, empty when nobody does; `counters` what was counted on the way
    to the device (a bus of servos: instructions, bytes, retries, timeouts, ...)."""

    connected: bool = False
    joints: tuple[JointStatus, ...] = ()
    moving: bool = False
    fault: str = ""
    holder: str = ""
    counters: dict[str, int] = {}


class CameraStatus(Said):
    """The camera; `rate_hz` over the last seconds, `newest_age_s` the age of the newest frame."""

    connected: bool = False
    rate_hz: float = 0.0
    newest_age_s: float | None = None
    drops: int = 0


class RigStatus(Said):
    """The role that holds the hardware. `holds` is what a simulated rig shows; `connections` names who is connected;
    `clock_ns` is the rig's clock, which all stamps are of, and `speed` how fast it runs (0: only while waited for)."""

    simulated: bool
    clock_ns: int
    speed: float
    holds: str = ""
    motion: MotionStatus = MotionStatus()
    camera: CameraStatus = CameraStatus()
    faults: tuple[str, ...] = ()
    connections: tuple[str, ...] = ()
    uptime_s: float


class CandidateStatus(Said):
    """One candidate: rating (1 is best), its best hypothesis' measures and its pose, object -> control.

    `probability` is null where the interpreter has none.
    """

    name: str
    rating: float
    w0: float
    w1_deg: float
    w2: float
    pose_quaternion_xyzw: tuple[float, float, float, float]
    spread_deg: float | None
    converged: bool
    probability: float | None = None


class ResultStatus(Said):
    """How the last task ended; the pose is null when it ended before it had begun.

    `indistinct` names those that remain when it is indistinguishable, `telling_view_deg` (azimuth, elevation) is the
    view that would tell them apart but cannot be reached, `pose_spread_deg` by how much the pose may be wrong.
    """

    task: str
    outcome: str
    object: str | None
    reason: str
    ratings: dict[str, float] = {}
    pose_quaternion_xyzw: tuple[float, float, float, float] | None = None
    looks: int = 0
    travel_deg: float = 0.0
    recording: str | None = None
    indistinct: tuple[str, ...] = ()
    telling_view_deg: tuple[float, float] | None = None
    pose_spread_deg: float | None = None

    @property
    def account(self) -> Account:
        """The same for people."""
        telling_view, spread = self.telling_view_deg, self.pose_spread_deg
        return Account(self.outcome, self.object or "", self.reason, self.indistinct, telling_view, spread)


class RecordingStatus(Said):
    """The recorder; `file` is the newest one, `lost` counts messages it could not keep up with in it."""

    enabled: bool
    file: str | None = None
    bytes: int = 0
    lost: int = 0
    open: bool = False


class LinkStatus(Said):
    """The engine's link to the rig. `clock_offset_s` is the rig's clock minus the engine's, null while not measured."""

    up: bool
    local: bool
    clock_offset_s: float | None = None
    round_trip_s: float | None = None


class EngineStatus(Said):
    """The role that thinks and records. `task` and `owner` are empty when nothing runs.

    `unknown` is the probability that the object is no candidate, null where the interpreter has none.
    """

    phase: str
    task: str = ""
    owner: str = ""
    seed: int | None = None
    candidates: tuple[CandidateStatus, ...] = ()
    unknown: float | None = None
    looks: int = 0
    travel_deg: float = 0.0
    result: ResultStatus | None = None
    models: dict[str, str] = {}
    learning: str = ""
    recording: RecordingStatus
    link: LinkStatus
    faults: tuple[str, ...] = ()
    uptime_s: float


class ReplayStatus(Said):
    """What is played as if it were live: `pace` is recorded seconds per second (0: as fast as possible)."""

    file: str
    pace: float
    position_s: float
    duration_s: float


class Status(Said):
    """The whole: `name` is the rig's; `alive` are the roles whose liveliness tokens are seen. Where `replay` is not
    null there is no rig: a recording is played."""

    schema_: str = STATUS_SCHEMA
    name: str
    alive: tuple[str, ...]
    build: dict[str, str]
    unix_ns: int
    rig: RigStatus | None = None
    engine: EngineStatus | None = None
    replay: ReplayStatus | None = None

    model_config = ConfigDict(
        extra="ignore",
        frozen=True,
        populate_by_name=True,
        alias_generator=lambda name: "schema" if name == "schema_" else name,
    )

    def to_json(self) -> bytes:
        """As it is sent."""
        return self.model_dump_json(by_alias=True).encode()


def merge(parts: Sequence[Status]) -> Status:
    """One status from the answers of the processes that serve one rig. Raises ValueError without any."""
    if not parts:
        raise ValueError("no part of a status")
    rig = next((part.rig for part in parts if part.rig), None)
    engine = next((part.engine for part in parts if part.engine), None)
    replay = next((part.replay for part in parts if part.replay), None)
    alive = tuple(sorted({role for part in parts for role in part.alive}))
    return parts[0].model_copy(update={"rig": rig, "engine": engine, "replay": replay, "alive": alive})
