"""What clients can do to a service: requests that make no sense, far too many of them, and viewers that are slow."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from processes import Serving, answers, complete, engine_of, running, serving, split, under_way, until

from viewsep.client import Client
from viewsep.service.names import Keys
from viewsep.service.requests import MAX_REQUEST_BYTES, REQUESTS
from viewsep.service.transport import MAX_MESSAGE_BYTES, client_session

BENCH = Keys("bench")
ENDS = ("identified", "undecided")
GARBAGE = 10_000
IN_FLIGHT = 64
GROWTH_MB = 50.0
ASKED = 300
PERIOD_S = 0.02
P99_S = 0.02
SLOWED = 2.0
ROUNDS = 5
NONSENSE = {
    "no payload": ("start", b"", "bad_json"),
    "no JSON": ("start", b'{"owner": ', "bad_json"),
    "no object": ("home", b"[1, 2]", "bad_json"),
    "no text": ("cancel", b"\xff\xfe\x00", "bad_json"),
    "deep": ("start", b"[" * 60_000, "bad_json"),
    "unknown field": ("start", b'{"owner": "x", "candidate": ["a"]}', "bad_request"),
    "missing field": ("record", b'{"owner": "x"}', "bad_request"),
    "wrong type": ("move", b'{"owner": "x", "joints_deg": "left"}', "bad_request"),
    "not finite": ("move", b'{"owner": "x", "joints_deg": [NaN, 1]}', "bad_request"),
    "a token of nobody": ("start", b'{"owner": "x", "token": "nobody"}', "bad_request"),
    "large": ("start", b'{"owner": "' + b"x" * MAX_REQUEST_BYTES + b'"}', "too_large"),
    "very large": ("learn", b"x" * (MAX_MESSAGE_BYTES // 2), "too_large"),
    "unknown command": ("dance", b'{"owner": "x"}', "unknown_command"),
}


@pytest.fixture
def short(seed_settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tasks of a few seconds."""
    return {**seed_settings, "camera": {"rate_hz": 8.0, "size_px": 64}, "task": {"max_looks": 60}}


@contextmanager
def asking(service: Serving) -> Iterator[zenoh.Session]:
    """A session that may ask anything."""
    session = client_session((service.endpoint,), None, "", 5.0)
    try:
        yield session
    finally:
        session.close()


def refusal(session: zenoh.Session, command: str, payload: bytes, timeout_s: float = 5.0) -> dict[str, Any] | None:
    """The one error reply, None when there is none."""
    replies = list(session.get(BENCH.command(command), payload=payload, timeout=timeout_s))
    said = [
        json.loads(reply.err.payload.to_bytes()) for reply in replies if reply.err and reply.err.payload != b"Timeout"
    ]
    assert not any(reply.ok for reply in replies)
    return said[0] if said else None


@pytest.mark.parametrize("apart", [False, True])
def test_requests_without_sense_are_refused_and_disturb_nobody(
    short: Mapping[str, Any], tmp_path: Path, apart: bool
) -> None:
    services = split(short, tmp_path) if apart else (Serving(tmp_path, short),)
    with serving(*services), services[0].client() as client, asking(services[0]) as session:
        until(lambda: client.status().engine, 10, "the engine is not there")
        task = client.start(seed=1)
        for name, (command, payload, code) in NONSENSE.items():
            said = refusal(session, command, payload)
            assert said is not None, name
            assert (said["accepted"], said["command"], said["code"]) == (False, command, code), name
            assert said["message"], name
        for name in REQUESTS:
            if name != "stop":  # which stops, whatever it says
                assert refusal(session, name, b"x" * (MAX_MESSAGE_BYTES + 1000), timeout_s=0.5) is None
        until(lambda: answers(client), 10, "no answer after requests that are too large for a message")
        result = client.wait(task, timeout_s=60)
        assert result.outcome in ENDS, result.reason
        complete(result, services[-1].folder)
        assert engine_of(client).recording.lost == 0
    assert all("Traceback" not in service.log for service in services)


def test_thousands_of_senseless_requests_change_nothing(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, {**short, "task": {"max_looks": 250}})
    random = np.random.default_rng(5)
    keys = [BENCH.status, *(BENCH.command(name) for name in REQUESTS if name != "stop")]  # a stop that is garbage stops
    with serving(service), service.client() as client, asking(service) as session:
        task = client.start(seed=1)
        under_way(client)
        flood(session, keys, random, GARBAGE // 20)
        before_mb = resident_mb(service)
        begun = time.monotonic()
        flood(session, keys, random, GARBAGE)
        took_s, grown_mb = time.monotonic() - begun, resident_mb(service) - before_mb
        print(f"\n{GARBAGE} requests in {took_s:.1f} s, {grown_mb:.1f} MB more memory", end="")  # noqa: T201
        assert grown_mb < GROWTH_MB
        result = client.wait(task, timeout_s=60)
        assert result.outcome in ENDS, result.reason
        assert engine_of(client).recording.lost == 0
        complete(result, service.folder)
        stopped = [reply.ok for reply in session.get(BENCH.command("stop"), payload=random.bytes(100), timeout=5.0)]
        assert [json.loads(said.payload.to_bytes())["accepted"] for said in stopped if said] == [True]
    assert "Traceback" not in service.log


def flood(session: zenoh.Session, keys: list[str], random: np.random.Generator, number: int) -> None:
    """Send random bytes; every reply is a status or a refusal, and every request is answered."""
    waiting: deque[tuple[str, Any]] = deque()
    for index in range(number + IN_FLIGHT):
        if index < number:
            key = keys[index % len(keys)]
            payload = random.bytes(int(random.integers(0, 2000)))
            waiting.append((key, session.get(key, payload=payload, timeout=30.0)))
        if index >= IN_FLIGHT and waiting:
            key, replies = waiting.popleft()
            (reply,) = list(replies)
            if key == BENCH.status:
                assert reply.ok is not None
                assert json.loads(reply.ok.payload.to_bytes())["name"] == "bench"
            else:
                assert reply.err is not None
                assert json.loads(reply.err.payload.to_bytes())["code"] == "bad_json"
    assert not waiting


def resident_mb(service: Serving) -> float:
    """Memory of the process."""
    assert service.process is not None
    status = (Path("/proc") / str(service.process.pid) / "status").read_text(encoding="utf-8")
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


PLAIN = (
    "import sys, time\n"
    "from viewsep.service.transport import client_session\n"
    "session = client_session((sys.argv[1],), None, '', 5.0)\n"
    "subscriber = session.declare_subscriber('viewsep/bench/camera/image')\n"
    "while True:\n"
    "    subscriber.recv(); print('sees', flush=True); time.sleep(0.1)\n"
)
RING = (
    "import sys, time\n"
    "from viewsep.client import Client\n"
    "client = Client('bench', connect=(sys.argv[2],)).__enter__()\n"
    "for picture in client.images((sys.argv[1],)):\n"
    "    print('sees', flush=True); time.sleep(0.1)\n"
)


@pytest.mark.alone
def test_a_slow_viewer_does_not_slow_down_the_status(settings: Mapping[str, Any], tmp_path: Path) -> None:
    at_work = {**settings["service"], "speed": 1.0}
    service = Serving(tmp_path, {**settings, "camera": {"rate_hz": 30.0}, "service": at_work})
    with serving(service), service.client() as client:
        until(lambda: client.status().rig, 10, "no status")
        best = {"nobody": p99_s(client)}
        for name, script in (("ring", RING), ("plain", PLAIN)):
            with running(script, f"tcp/127.0.0.1:{service.image_port}", service.endpoint) as viewer:
                assert viewer.stdout is not None
                assert viewer.stdout.readline() == "sees\n"
                best[name] = best_p99_s(client)
                assert viewer.poll() is None
    figures = ", ".join(f"{name} {1e3 * p99:.1f}" for name, p99 in best.items())
    print(f"\nstatus, best p99 in ms with a viewer that is: {figures}", end="")  # noqa: T201
    allowed_s = max(P99_S, SLOWED * best["nobody"])  # where the machine itself is slow, only the ratio says anything
    assert max(best["ring"], best["plain"]) <= allowed_s, figures


def best_p99_s(client: Client) -> float:
    """The lowest p99 of up to ROUNDS rounds, as the machine is shared; no more rounds than it takes."""
    best = np.inf
    for _ in range(ROUNDS):
        best = min(best, p99_s(client))
        if best <= P99_S:
            break
    return best


def p99_s(client: Client) -> float:
    """p99 of the time that a status takes, asked for at 50 Hz."""
    took: list[float] = []
    for _ in range(ASKED):
        begun = time.monotonic()
        client.status()
        took.append(time.monotonic() - begun)
        time.sleep(max(0.0, PERIOD_S - took[-1]))
    return float(np.percentile(took, 99))
