"""A service made of bytes: it answers and publishes what docs/service.md says, or whatever a test wants instead.

It knows nothing of viewsep, so that what it says cannot change together with the client that is tested.
"""

from __future__ import annotations

import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh
from ports import free_port

PATIENCE_S = 10.0
Table = dict[str, Any]
Handler = Callable[[zenoh.Query, Table], None]

RIG: Table = {
    "simulated": True,
    "clock_ns": 5_000_000_000,
    "speed": 1.0,
    "holds": "generated:7",
    "motion": {
        "connected": True,
        "joints": [
            {"name": "pan", "position_deg": 10.0, "setpoint_deg": 10.0, "temperature_c": 31.0},
            {"name": "tilt", "position_deg": -20.0, "setpoint_deg": -20.0, "temperature_c": None},
        ],
        "moving": False,
        "fault": "",
        "holder": "",
        "counters": {},
    },
    "camera": {"connected": True, "rate_hz": 4.0, "newest_age_s": 0.12, "drops": 3},
    "faults": [],
    "connections": [],
    "uptime_s": 12.5,
}
ENGINE: Table = {
    "phase": "exploring",
    "task": "",
    "owner": "",
    "seed": None,
    "candidates": [
        {
            "name": "tea",
            "rating": 1.5,
            "w0": 0.9,
            "w1_deg": 3.0,
            "w2": 0.8,
            "pose_quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
            "spread_deg": None,
            "converged": False,
            "probability": None,
        }
    ],
    "unknown": None,
    "looks": 4,
    "travel_deg": 30.0,
    "result": None,
    "models": {"tea": "0" * 64, "decaf": "1" * 64},
    "learning": "",
    "recording": {"enabled": True, "file": None, "bytes": 0, "lost": 0, "open": False},
    "link": {"up": True, "local": True, "clock_offset_s": None, "round_trip_s": None},
    "faults": [],
    "uptime_s": 12.5,
}


def result(task: str, outcome: str = "identified", found: str | None = "tea", **more: Any) -> Table:
    """How a task ended, as the status says it."""
    return {
        "task": task,
        "outcome": outcome,
        "object": found,
        "reason": "rated 5 times better",
        "ratings": {"tea": 1.0, "decaf": 7.5},
        "pose_quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
        "looks": 9,
        "travel_deg": 123.0,
        "recording": None,
        "indistinct": [],
        "telling_view_deg": None,
        "pose_spread_deg": None,
        **more,
    }


class FakeService:
    """A peer on a free port of 127.0.0.1 that serves `roles` of `rig`.

    `status` is what it says of itself; `handlers` answers queries by the end of their keys (`status`, `cmd/start`...);
    `asked` are the ends of all keys that were queried, `requests` the commands among them, `tokens` the lease tokens
    that are seen now.
    """

    def __init__(self, rig: str = "bench", roles: tuple[str, ...] = ("rig", "engine"), connect: str = "") -> None:
        self.rig, self.roles = rig, roles
        self.status: Table = {
            "schema": "viewsep.status/1",
            "name": rig,
            "alive": list(roles),
            "build": {"viewsep": "0.1.0"},
            "unix_ns": 1,
            "rig": json.loads(json.dumps(RIG)) if "rig" in roles else None,
            "engine": json.loads(json.dumps(ENGINE)) if "engine" in roles else None,
            "replay": None,
        }
        self.asked: list[str] = []
        self.requests: list[tuple[str, Table]] = []
        self.tokens: set[str] = set()
        self.handlers: dict[str, Handler] = {
            "status": lambda query, _: say(query, self.status),
            "manifest": lambda query, _: say(query, {"schema": "viewsep.manifest/1", "roles": list(roles)}),
            "cmd/stop": lambda query, _: accept(query, roles=list(roles)),
        }
        if "engine" in roles:
            self.handlers |= {
                "cmd/start": self._start,
                "cmd/cancel": lambda query, _: accept(query),
                "cmd/learn": lambda query, _: accept(query),
                "cmd/record": lambda query, _: accept(query),
            }
        if "rig" in roles:
            self.handlers |= {
                "cmd/home": lambda query, _: accept(query, setpoint_deg=[0.0, 0.0]),
                "cmd/move": lambda query, _: accept(query, setpoint_deg=[10.0, -20.0]),
                "cmd/clear_fault": lambda query, _: accept(query),
            }
        self.held: list[zenoh.Query] = []
        self.port = free_port()
        self._sequences: dict[str, int] = {}
        self._clock_ns = 1000
        self._session = _peer(self.port, connect)
        self._alive = [self._session.liveliness().declare_token(f"viewsep/{rig}/alive/{role}") for role in roles]
        self._lease = self._session.liveliness().declare_subscriber(
            f"viewsep/{rig}/lease/*", self._see_token, history=True
        )
        keys = [f"viewsep/{rig}/{end}" for end in self.handlers]
        self._queryables = [self._session.declare_queryable(key, self._answer) for key in keys]

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self.port}"

    @property
    def engine(self) -> Table:
        """The engine's section of the status."""
        section: Table = self.status["engine"]
        return section

    @property
    def motion(self) -> Table:
        """The motion in the rig's section of the status."""
        section: Table = self.status["rig"]["motion"]
        return section

    def publish(self, topic: str, payload: bytes, *, skip: int = 0, attachment: bytes | None = None) -> None:
        """Publish bytes on a stream with the next sequence number, or a later one."""
        sequence = self._sequences.get(topic, 0) + skip
        self._sequences[topic] = sequence + 1
        self._clock_ns += 1
        given = struct.pack("<Qq", sequence, self._clock_ns) if attachment is None else attachment
        self._session.put(f"viewsep/{self.rig}/{topic}", payload, attachment=given)

    def watched(self, topic: str) -> bool:
        """Whether anybody subscribes to a stream."""
        publisher = self._session.declare_publisher(f"viewsep/{self.rig}/{topic}")
        matching = bool(publisher.matching_status.matching)  # type: ignore[attr-defined]  # the stub says bool
        publisher.undeclare()
        return matching

    def end_task(self, task: str, outcome: str = "identified", found: str | None = "tea", **more: Any) -> None:
        """The task has ended, says the status."""
        self.status["engine"] = {**self.engine, "task": "", "owner": "", "result": result(task, outcome, found, **more)}

    def close(self) -> None:
        if not self._session.is_closed():
            self.held.clear()
            for queryable in self._queryables:
                queryable.undeclare()
            self._lease.undeclare()
            for token in self._alive:
                token.undeclare()
            self._session.close()

    def _start(self, query: zenoh.Query, request: Table) -> None:
        self.status["engine"] = {**self.engine, "task": "t1", "owner": request["owner"]}
        accept(query, task="t1")

    def _answer(self, query: zenoh.Query) -> None:
        end = str(query.key_expr).split("/", 2)[2]
        request = {} if query.payload is None else json.loads(query.payload.to_bytes())
        self.asked.append(end)
        if end.startswith("cmd/"):
            self.requests.append((end.removeprefix("cmd/"), request))
        self.handlers[end](query, request)
        if query not in self.held:
            query.drop()

    def _see_token(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr).rsplit("/", 1)[1]
        (self.tokens.add if sample.kind == zenoh.SampleKind.PUT else self.tokens.discard)(token)


@contextmanager
def fake_service(*args: Any, **kwargs: Any) -> Iterator[FakeService]:
    service = FakeService(*args, **kwargs)
    try:
        yield service
    finally:
        service.close()


def say(query: zenoh.Query, table: Any) -> None:
    query.reply(query.key_expr, json.dumps(table), encoding="application/json")


def accept(query: zenoh.Query, **said: Any) -> None:
    say(query, {"accepted": True, "command": str(query.key_expr).rsplit("/", 1)[1], **said})


def refuse(code: str, message: str) -> Handler:
    """Answers with a refusal."""
    said = {"accepted": False, "command": "?", "code": code, "message": message}
    return lambda query, _: query.reply_err(json.dumps(said), encoding="application/json")


def raw(payload: bytes) -> Handler:
    """Answers with these bytes."""
    return lambda query, _: query.reply(query.key_expr, payload)


def raw_error(payload: bytes) -> Handler:
    """Answers with these bytes as an error."""
    return lambda query, _: query.reply_err(payload)


def silent(service: FakeService) -> Handler:
    """Never answers."""
    return lambda query, _: service.held.append(query)


def until(what: Callable[[], Any], says: str) -> None:
    """Waits for a condition; fails when it does not come true in time."""
    deadline = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline, says
        time.sleep(0.01)


def later(what: Callable[[], Any]) -> threading.Thread:
    """Runs in a thread that is joined by whoever started it."""
    thread = threading.Thread(target=what)
    thread.start()
    return thread


def _peer(port: int, connect: str) -> zenoh.Session:
    table = {
        "mode": "peer",
        "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "connect": {"endpoints": [connect] if connect else []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(table)))
