"""What may be asked of a service: JSON requests, checked, and the replies to them."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from viewsep.errors import ViewsepError

MAX_REQUEST_BYTES = 64 * 1024
MAX_SEED = 2**62


class Code(StrEnum):
    """Why a request was refused."""

    TOO_LARGE = "too_large"
    BAD_JSON = "bad_json"
    BAD_REQUEST = "bad_request"  # unknown field, wrong type, value out of range
    UNKNOWN_COMMAND = "unknown_command"
    BUSY = "busy"  # a task or a move of somebody else is under way
    NO_TASK = "no_task"
    NOT_OWNER = "not_owner"
    NO_MODELS = "no_models"
    UNKNOWN_MODEL = "unknown_model"
    UNREACHABLE = "unreachable"  # a view or joint angles outside the limits
    FAULT = "fault"  # of the rig, or of the file system
    RIG_LOST = "rig_lost"
    UNAVAILABLE = "unavailable"  # shutting down
    REPLAY = "replay"  # a recording is played: there is no rig
    INTERNAL = "internal"


class Refused(ViewsepError):
    """A request that is not carried out. `code` is for programs, the message for people."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code


class Request(BaseModel):
    """Fields of every request: `owner` says who asks; `token` ties what is started to the liveliness of
    `viewsep/{rig}/lease/{token}`; without one it goes on when the client has gone."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    owner: str = Field(min_length=1, max_length=100)
    token: str = Field(default="", pattern=r"^[A-Za-z0-9_-]{0,64}$")


class StartRequest(Request):
    """Tell the object apart from the candidates (all models of the library when empty).

    With `pose_tolerance_deg` it goes on until the pose is known that well, too; without, as the service is configured.
    """

    candidates: tuple[str, ...] = Field(default=(), max_length=1000, strict=False)
    seed: int = Field(default=0, ge=0, le=MAX_SEED)
    pose_tolerance_deg: float | None = Field(default=None, gt=0, le=180)


class CancelRequest(Request):
    """End the running task; only its owner may."""

    reason: str = Field(default="", max_length=500)


class HomeRequest(Request):
    """Drive all joints to their home position."""


class StopRequest(Request):
    """Stop the motion where it is and end whatever runs, whoever started it."""

    reason: str = Field(default="", max_length=500)


class ClearFaultRequest(Request):
    """Clear the faults of the motion."""


class MoveRequest(Request):
    """Drive the joints to angles, or to where a view direction of the control frame faces the camera; degrees."""

    joints_deg: tuple[float, ...] | None = Field(default=None, min_length=1, max_length=32, strict=False)
    view_deg: tuple[float, float] | None = Field(default=None, strict=False)

    @model_validator(mode="after")
    def _one_goal(self) -> MoveRequest:
        if (self.joints_deg is None) == (self.view_deg is None):
            raise ValueError("give joints_deg or view_deg (azimuth, elevation), and not both")
        return self


class LearnRequest(Request):
    """Learn a model into the service's library: `source` as for `viewsep learn`; `views` of a mesh (100 by default)."""

    source: str = Field(min_length=1, max_length=500)
    name: str = Field(default="", max_length=100)
    views: int | None = Field(default=None, ge=4, le=2000)


class RecordRequest(Request):
    """Record the tasks from the next one on, or not."""

    enabled: bool


REQUESTS: dict[str, type[Request]] = {
    "start": StartRequest,
    "cancel": CancelRequest,
    "home": HomeRequest,
    "stop": StopRequest,
    "clear_fault": ClearFaultRequest,
    "move": MoveRequest,
    "learn": LearnRequest,
    "record": RecordRequest,
}


def parse_request(command: str, payload: bytes) -> Request:
    """The checked request. Raises Refused naming field, value and remedy."""
    kind = REQUESTS.get(command)
    if kind is None:
        raise Refused(Code.UNKNOWN_COMMAND, f"there is no command {command!r}: use one of {', '.join(REQUESTS)}")
    if len(payload) > MAX_REQUEST_BYTES:
        raise Refused(
            Code.TOO_LARGE, f"a request of {len(payload)} bytes is too large: at most {MAX_REQUEST_BYTES} are read"
        )
    try:
        table = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise Refused(Code.BAD_JSON, f"the request is not JSON: {error}") from None
    if not isinstance(table, dict):
        raise Refused(Code.BAD_JSON, f"the request must be a JSON object, not {type(table).__name__}")
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise Refused(Code.BAD_REQUEST, f"{command}: {_sentence(error, kind)}") from None


def accepted(command: str, **said: Any) -> bytes:
    """The reply to a request that is carried out."""
    return json.dumps({"accepted": True, "command": command, **said}).encode()


def refused(command: str, error: Refused) -> bytes:
    """The error reply to a request that is not."""
    said = {"accepted": False, "command": command, "code": error.code.value, "message": str(error)}
    return json.dumps(said).encode()


def _sentence(error: ValidationError, kind: type[Request]) -> str:
    first = error.errors()[0]
    field = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return f"unknown field {field!r}: known are {', '.join(kind.model_fields)}"
    if first["type"] == "missing":
        return f"field {field!r} is missing"
    value = repr(first["input"])
    shown = value if len(value) <= 80 else value[:77] + "..."
    return f"field {field!r} = {shown}: {first['msg'][0].lower()}{first['msg'][1:]}" if field else first["msg"]
