"""The rig's interfaces as remote calls: what is asked, checked, and how errors come back as what they were."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from viewsep.config import DescriptorConfig, explain
from viewsep.errors import (
    BadConfig,
    BadInput,
    LeaseLost,
    MoveRefused,
    NotConnected,
    RigError,
    Timeout,
    UnreachableView,
    ViewsepError,
)
from viewsep.service.looks import Send
from viewsep.service.requests import MAX_REQUEST_BYTES, Code, Refused

MAX_WAIT_S = 60.0  # of one call, on the rig's clock
INT64 = 2**63


class Call(BaseModel):
    """Fields of every call. `caller` and `number` tell a call from its repetition, `holder` renews its lease."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    caller: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    number: int = Field(ge=0, lt=INT64)
    holder: str = Field(default="", max_length=200)


class HolderCall(Call):
    """A call that only the holder of the lease may make."""

    holder: str = Field(min_length=1, max_length=200)


class HistoryCall(Call):
    """Read-backs since a moment."""

    since_ns: int = Field(ge=-INT64, lt=INT64)


class MoveCall(HolderCall):
    """Set-points; whether they can be reached the motion says."""

    position_rad: tuple[float, ...] = Field(max_length=32, strict=False)


class FrameCall(Call):
    """The first frame after a moment."""

    newer_than_ns: int = Field(ge=-INT64, lt=INT64)
    timeout_s: float = Field(ge=0, le=MAX_WAIT_S)


class LookCall(FrameCall):
    """The first look after a moment; the descriptor is the engine's."""

    send: Send
    descriptor: DescriptorConfig = Field(strict=False)


class SleepCall(Call):
    """Let simulated time pass."""

    until_ns: int = Field(ge=0, lt=INT64)


CALLS: dict[str, type[Call]] = {
    "describe": Call,
    "clock": Call,
    "sleep": SleepCall,
    "acquire": HolderCall,
    "release": HolderCall,
    "state": Call,
    "history": HistoryCall,
    "move_to": MoveCall,
    "stop": HolderCall,
    "fault": Call,
    "clear_fault": HolderCall,
    "temperatures": Call,
    "counters": Call,
    "look": LookCall,
    "frame": FrameCall,
}
READ_ONLY = frozenset({"describe", "clock", "state", "history", "fault", "temperatures", "counters"})
"""What may be answered anew when it is asked again; everything else is carried out once."""

WAITING = frozenset({"look", "frame", "sleep"})
"""What may take a while."""

_CODES: tuple[tuple[type[ViewsepError], Code], ...] = (
    (LeaseLost, Code.NOT_OWNER),
    (MoveRefused, Code.UNREACHABLE),
    (UnreachableView, Code.UNREACHABLE),
    (Timeout, Code.FAULT),
    (NotConnected, Code.FAULT),
    (RigError, Code.FAULT),
    (BadConfig, Code.BAD_REQUEST),
    (BadInput, Code.BAD_REQUEST),
)
_ERRORS = {kind.__name__: kind for kind, _ in _CODES}


def parse_call(name: str, payload: bytes) -> Call:
    """The checked call. Raises Refused naming field, value and remedy."""
    kind = CALLS.get(name)
    if kind is None:
        raise Refused(Code.UNKNOWN_COMMAND, f"the rig has no call {name!r}: use one of {', '.join(CALLS)}")
    if len(payload) > MAX_REQUEST_BYTES:
        raise Refused(Code.TOO_LARGE, f"a call of {len(payload)} bytes is too large: at most {MAX_REQUEST_BYTES}")
    try:
        table = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise Refused(Code.BAD_JSON, f"the call is not JSON: {error}") from None
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise Refused(Code.BAD_REQUEST, f"rig/{name}: {explain(error)}") from None


def error_reply(name: str, error: Exception) -> bytes:
    """An error as it is sent: code and message as for every refused request, and the class it is raised as again."""
    code, kind = Code.INTERNAL, "RigError"
    message = str(error) if isinstance(error, ViewsepError) else f"the rig's side failed: {error!r}"
    if isinstance(error, Refused):
        code, kind = error.code, "Refused"
    else:
        for candidate, its_code in _CODES:
            if isinstance(error, candidate):
                code, kind = its_code, candidate.__name__
                break
    said = {"accepted": False, "command": name, "code": code.value, "message": message, "error": kind}
    return json.dumps(said).encode()


def error_from(data: bytes) -> ViewsepError:
    """The error that was sent."""
    try:
        said: dict[str, Any] = json.loads(data)
        message, code = str(said["message"]), Code(said["code"])
    except (ValueError, TypeError, KeyError):
        return RigError(f"the rig answered with an error that cannot be read: {data[:200]!r}")
    kind = _ERRORS.get(str(said.get("error", "")))
    return Refused(code, message) if kind is None else kind(message)
