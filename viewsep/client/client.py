"""One rig, asked and told what to do."""

from __future__ import annotations

import getpass
import json
import socket
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh

from viewsep.client.discovery import CONNECT, check_rig_name, images_endpoints, open_session, seen_rigs
from viewsep.client.errors import NoAnswer, RequestRefused
from viewsep.client.queries import Answer, ask, put_together, read_status, said
from viewsep.client.streams import Pictures, Received, Stream
from viewsep.client.waiting import wait_for_result, wait_until_settled
from viewsep.errors import BadInput, NotConnected
from viewsep.service.names import STREAMS, Keys, Role
from viewsep.service.status import ResultStatus, Status, merge

FOREVER_S = float("inf")
_ROLES = tuple(role.value for role in Role)


@dataclass(frozen=True, slots=True)
class Stopped:
    """Which roles stopped, and which gave no answer (they do not run, hang, or cannot be reached)."""

    roles: tuple[str, ...]
    silent: tuple[str, ...]


class Client:
    """A rig's client; `with Client(...) as client:`, or `open()` and `close()`. Not to be shared between threads.

    `rig` is the rig's name, None for the only one there is. `connect` are endpoints of the service, of which the first
    that answers is used; `keys` the folder of certificates and `certificate` the one to show (none: loopback only).
    `owner` is who asks, user@host when empty. `timeout_s` bounds every single answer.

    Every method may raise NoAnswer, BadReply and NotConnected; requests raise RequestRefused.
    """

    def __init__(
        self,
        rig: str | None = None,
        connect: Sequence[str] = CONNECT,
        owner: str = "",
        keys: str | None = None,
        certificate: str = "",
        timeout_s: float = 2.0,
    ) -> None:
        self.owner = owner or f"{getpass.getuser()}@{socket.gethostname()}"[:100]
        self.timeout_s = timeout_s
        self._rig = rig
        self._connect = tuple(connect)
        self._keys = keys
        self._certificate = certificate
        self._session: zenoh.Session | None = None
        self._tokens: dict[str, zenoh.LivelinessToken] = {}  # by task; "" is that of a move
        self._listening: list[Stream | Pictures] = []

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def open(self) -> None:
        """Connect. Raises NoAnswer; BadInput for endpoints, names or keys that cannot be used."""
        if self._rig is not None:
            check_rig_name(self._rig)
        if self._session is None:
            self._session = open_session(self._connect, self._keys, self._certificate, self.timeout_s)
        if self._rig is None:
            try:
                self._rig = self._only_rig()
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Stop listening, let go of what was started attached, disconnect. More than once does no harm."""
        while self._listening:
            self._listening.pop().close()
        while self._tokens:
            self._tokens.popitem()[1].undeclare()
        if self._session is not None:
            self._session.close()
            self._session = None

    @property
    def rig(self) -> str:
        """The rig's name."""
        if self._rig is None:
            raise NotConnected("this client has no rig yet: use `with Client(...) as client:`")
        return self._rig

    def status(self) -> Status:
        """What all roles say of themselves, put together. Raises BadInput where only other rigs answer."""
        key = Keys(self.rig).status
        parts = [read_status(key, table) for table in self._tables(key)]
        return merge(parts)

    def manifest(self) -> dict[str, Any]:
        """Keys, schemas and versions of all roles."""
        return put_together(self._tables(Keys(self.rig).manifest))

    def start(
        self,
        candidates: Sequence[str] = (),
        seed: int = 0,
        detach: bool = False,
        pose_tolerance_deg: float | None = None,
    ) -> str:
        """Start a task among `candidates` (all models when empty); its name.

        With `pose_tolerance_deg` it goes on until the pose is known that well, too. The task is stopped when this
        client closes or is gone, unless it was started with `detach`.
        """
        token = "" if detach else self._declare_token("")
        fields: dict[str, Any] = {"token": token, "candidates": list(candidates), "seed": seed}
        if pose_tolerance_deg is not None:  # services from before it refuse what they do not know
            fields["pose_tolerance_deg"] = pose_tolerance_deg
        try:
            task = said(self.request("start", fields), "task", str)
        except BaseException:
            self._release("")
            raise
        if token:
            self._tokens[task] = self._tokens.pop("")
        return task

    def wait(
        self,
        task: str,
        timeout_s: float = FOREVER_S,
        heard: Callable[[Received], None] | None = None,
        stream: Stream | None = None,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> ResultStatus:
        """How `task` ended, as soon as it has; `heard` gets all messages meanwhile.

        `interrupted` is asked twice a second; where it says so, the waiting ends with KeyboardInterrupt.
        A `stream` that was opened before misses none of them; else one is opened now. Raises Timeout when the task goes
        on after `timeout_s`, TaskLost when the service knows neither it nor its result, NoAnswer when it went away.
        """
        own = stream or self.watch(STREAMS if heard else ("result",))
        try:
            hears, grace_s = heard or (lambda _received: None), max(2.0, self.timeout_s)
            result = wait_for_result(task, self.status, own, hears, timeout_s, grace_s, interrupted)
        finally:
            if stream is None:
                own.close()
        self._release(task)
        return result

    def run(
        self,
        candidates: Sequence[str] = (),
        seed: int = 0,
        timeout_s: float = FOREVER_S,
        pose_tolerance_deg: float | None = None,
    ) -> ResultStatus:
        """Start a task and wait for its result."""
        return self.wait(self.start(candidates, seed, pose_tolerance_deg=pose_tolerance_deg), timeout_s)

    def cancel(self, reason: str = "") -> None:
        """End the running task; only who started it may."""
        self.request("cancel", {"reason": reason})

    def stop(self, reason: str = "") -> Stopped:
        """Stop the motion where it is and end whatever runs, whoever started it.

        Raises RequestRefused when no role stopped, NoAnswer when none answered.
        """
        answers = self._ask("stop", {"owner": self.owner, "reason": reason}, everybody=True)
        stopped = {role for answer in answers if isinstance(answer, dict) for role in _speakers(answer)}
        refusals = [answer for answer in answers if isinstance(answer, RequestRefused)]
        if not stopped and refusals:
            raise refusals[0]
        return Stopped(tuple(sorted(stopped)), tuple(role for role in _ROLES if role not in stopped))

    def home(self, detach: bool = True) -> tuple[float, ...]:
        """Drive all joints home; their set-points in degrees. Returns at once: see `settle`.

        Without `detach` the move is stopped when this client closes or is gone.
        """
        return self._move("home", {}, detach)

    def move(
        self,
        joints_deg: Sequence[float] | None = None,
        view_deg: tuple[float, float] | None = None,
        detach: bool = True,
    ) -> tuple[float, ...]:
        """Drive the joints to angles, or to where a view (azimuth, elevation) faces the camera; their set-points.

        Returns at once: see `settle`. Without `detach` the move is stopped when this client closes or is gone.
        """
        if (joints_deg is None) == (view_deg is None):
            raise BadInput("move: give joints_deg or view_deg, and not both")
        goal = {"view_deg": list(view_deg)} if view_deg is not None else {"joints_deg": list(joints_deg or ())}
        return self._move("move", goal, detach)

    def settle(self, setpoint_deg: Sequence[float], timeout_s: float = FOREVER_S) -> None:
        """Wait until the joints stand still at `setpoint_deg`, which `home` and `move` give.

        Raises Timeout, and RigError when they end up elsewhere.
        """
        wait_until_settled(setpoint_deg, self.status, timeout_s, max(2.0, self.timeout_s))
        self._release("")

    def clear_fault(self) -> None:
        """Clear the faults of the motion."""
        self.request("clear_fault")

    def learn(self, source: str, name: str = "", views: int | None = None) -> None:
        """Have the service learn a model into its library, of a mesh from `views` views (100 if None).

        Returns at once: `status().engine` says what is being learned, which models there are, and faults.
        """
        self.request("learn", {"source": source, "name": name} | ({} if views is None else {"views": views}))

    def record(self, enabled: bool) -> None:
        """Record the tasks from the next one on, or not."""
        self.request("record", {"enabled": enabled})

    def request(self, command: str, fields: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Any request by name; the reply. `owner` is this client's unless given."""
        answers = self._ask(command, {"owner": self.owner, **(fields or {})}, everybody=False)
        refusals = [answer for answer in answers if isinstance(answer, RequestRefused)]
        if refusals:
            raise refusals[0]
        return next(answer for answer in answers if isinstance(answer, dict))

    def watch(self, topics: Sequence[str] = STREAMS) -> Stream:
        """The messages of `topics` from now on; close it, or use it in a `with`."""
        unknown = [topic for topic in topics if topic not in STREAMS]
        if unknown:
            raise BadInput(f"there is no stream {unknown[0]!r}: choose of {', '.join(STREAMS)}")
        stream = Stream(self._open_session(), self.rig, topics)
        self._listening.append(stream)
        return stream

    def images(self, connect: Sequence[str] = ()) -> Pictures:
        """The newest pictures from now on, over a session of their own; close it, or use it in a `with`.

        `connect` are the endpoints, of which the first that answers is used; by default those that the manifest names.
        """
        where = tuple(connect) or images_endpoints(self.manifest(), self._connect)
        session = open_session(where, self._keys, self._certificate, self.timeout_s)
        pictures = Pictures(session, self.rig)
        self._listening.append(pictures)
        return pictures

    def _move(self, command: str, goal: dict[str, Any], detach: bool) -> tuple[float, ...]:
        token = "" if detach else self._declare_token("")
        try:
            reply = self.request(command, {"token": token, **goal})
        except BaseException:
            self._release("")
            raise
        return tuple(float(angle) for angle in said(reply, "setpoint_deg", list))

    def _tables(self, key: str) -> list[dict[str, Any]]:
        """What everybody answers to a question that nobody refuses."""
        answers = ask(self._open_session(), key, self.timeout_s, everybody=True)
        tables = [answer for answer in answers if isinstance(answer, dict)]
        if not tables:
            refusals = [answer for answer in answers if isinstance(answer, RequestRefused)]
            raise refusals[0] if refusals else self._silence()
        return tables

    def _ask(self, command: str, request: dict[str, Any], everybody: bool) -> list[Answer]:
        key = Keys(self.rig).command(command)
        answers = ask(self._open_session(), key, self.timeout_s, json.dumps(request).encode(), everybody)
        if not answers:
            raise self._silence()
        return answers

    def _silence(self) -> BadInput | NoAnswer:
        """What it means that nobody answers: other rigs do, or nobody is there."""
        where = ", ".join(self._connect)
        others = [rig.name for rig in seen_rigs(self._open_session(), self.timeout_s)]
        if others and self.rig not in others:
            return BadInput(f"there is no rig {self.rig!r} at {where}: choose {' or '.join(others)}")
        within = f"within {self.timeout_s:g} s"
        return NoAnswer(f"no answer from {where} for rig {self.rig!r} {within}: not running, or not allowed")

    def _only_rig(self) -> str:
        where = ", ".join(self._connect)
        rigs = [rig.name for rig in seen_rigs(self._open_session(), self.timeout_s)]
        if not rigs:
            raise NoAnswer(f"no rig is served at {where}, or this client is not allowed to see it")
        if len(rigs) > 1:
            raise BadInput(f"there are several rigs at {where}: name {' or '.join(rigs)}")
        return rigs[0]

    def _open_session(self) -> zenoh.Session:
        if self._session is None:
            raise NotConnected("this client is closed: use `with Client(...) as client:`")
        return self._session

    def _declare_token(self, task: str) -> str:
        """A new lease token, seen as long as this client lives."""
        self._release(task)
        token = uuid.uuid4().hex
        self._tokens[task] = self._open_session().liveliness().declare_token(Keys(self.rig).lease(token))
        return token

    def _release(self, task: str) -> None:
        token = self._tokens.pop(task, None)
        if token is not None:
            token.undeclare()


def _speakers(answer: dict[str, Any]) -> tuple[str, ...]:
    """The roles that an answer to `stop` speaks for."""
    roles = answer.get("roles", ())
    return tuple(str(role) for role in roles) if isinstance(roles, list) else ()
