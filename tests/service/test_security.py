"""Who may do what at a real service with real keys: what the rig, its log and a witness say afterwards counts."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from foxglove_schemas_protobuf.Log_pb2 import Log
from processes import Serving, serving, until
from served_rig import ASK, answers, end, rogue, sign_again

from viewsep.cli.app import app
from viewsep.client import Client, LogLine, NoAnswer, Received, RequestRefused, rigs
from viewsep.keys import KeyRole, init_keys, issue
from viewsep.messages import Outcome, Result
from viewsep.recordings.codec import to_bytes
from viewsep.service.names import LOG, STREAMS, attachment
from viewsep.service.requests import Code
from viewsep.service.status import MotionStatus, Status

OWNER = "mallory"
"""Whoever asks for what is forbidden; must never show up in what a service says."""
ISSUED = {"rig": "rig", "engine": "engine", "op": "operator", "view": "viewer", "wall": "viewer", "gone": "operator"}
FORGED = Result(0, Outcome.IDENTIFIED, OWNER, OWNER, ((OWNER, 1.0),), np.eye(3), 1, 0.0, 0)
ENGINE_SAYS = frozenset(STREAMS) - {LOG, "motion/state"}
TO_THE_END = {"identified": 0, "undecided": 3}
"""Exit codes of tasks that nobody ended. Which of the two it is depends on how busy the computer is."""
Attack = Callable[[zenoh.Session], Any]
"""What is tried with a session; what it declares is returned, so that it stays."""


def viewsep(*typed: str | Path) -> subprocess.CompletedProcess[str]:
    """A `viewsep` command in a process of its own."""
    command = [sys.executable, "-m", "viewsep", *map(str, typed)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of everybody in ISSUED, of which `gone` is revoked; `late` expired yesterday."""
    folder = tmp_path_factory.mktemp("security") / "keys"
    typed = [["init", str(folder)]]
    typed += [["issue", name, "--role", role, "--keys", str(folder)] for name, role in ISSUED.items()]
    typed += [["issue", "late", "--role", "operator", "--keys", str(folder)], ["revoke", "gone", "--keys", str(folder)]]
    for words in typed:
        app(["keys", *words], standalone_mode=False)
    sign_again(folder, "late", -1)
    return folder


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of somebody else's, with an operator of the same name."""
    folder = tmp_path_factory.mktemp("other") / "keys"
    init_keys(folder)
    issue(folder, "op", KeyRole.OPERATOR)
    return folder


@dataclass
class Secured:
    """A service by TLS, as one process or two, and a witness who watches everything as a viewer."""

    keys: Path
    rig: Serving
    engine: Serving
    heard: list[tuple[str, Any]] = field(default_factory=list)

    @property
    def processes(self) -> list[Serving]:
        return [self.rig] if self.engine is self.rig else [self.rig, self.engine]

    @property
    def doors(self) -> list[tuple[Serving, str, str]]:
        """Every endpoint: the process, the endpoint, and what the log calls it."""
        control = [(process, process.endpoint, "control") for process in self.processes]
        return [*control, (self.rig, self.rig.image_endpoint, "images")]

    @property
    def log(self) -> str:
        return "".join(process.log for process in self.processes)

    def client(self, name: str, **options: Any) -> Client:
        """A client with a certificate."""
        return self.rig.client(owner=name, keys=str(self.keys), certificate=name, **options)

    def command(self, name: str, *typed: str) -> subprocess.CompletedProcess[str]:
        """A command with a certificate."""
        return viewsep(*typed, "--connect", self.rig.endpoint, "--keys", self.keys, "--as", name)


@pytest.fixture(scope="module", params=["one process", "two processes"])
def service(
    request: pytest.FixtureRequest, keys: Path, look_alikes: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Secured]:
    """A service that has ended one task of an operator's, and holds the object somewhere."""
    folder = tmp_path_factory.mktemp("secured")
    common = {"name": "bench", "library": str(look_alikes), "recordings": str(folder / "recordings"), "speed": 10.0}

    def process(name: str, *arguments: str, **service: Any) -> Serving:
        table = {**common, "keys": str(keys), "certificate": name, **service}
        return Serving(folder / name, {"camera": {"rate_hz": 8.0}, "service": table}, arguments)

    if request.param == "one process":
        rig = engine = process("rig")
    else:
        rig = process("rig", "--role", "rig")
        engine = process("engine", "--role", "engine", connect=[rig.endpoint])
    secured = Secured(keys, rig, engine)
    with serving(*secured.processes):
        with secured.client("op") as operator:
            until(lambda: operator.status().engine, 10, "the engine is not there")
        done = secured.command("op", "start", "--wait", "--seed", "1", "--json")
        assert done.returncode == TO_THE_END[json.loads(done.stdout)["outcome"]], done.stderr
        yield secured


def state(status: Status) -> tuple[Any, ...]:
    """All that a request could change."""
    assert status.rig is not None
    assert status.engine is not None
    motion, engine = status.rig.motion, status.engine
    joints = tuple((joint.position_deg, joint.setpoint_deg) for joint in motion.joints)
    moved = (joints, motion.moving, motion.holder, motion.fault, status.rig.faults)
    thought = (engine.phase, engine.task, engine.result, engine.learning, tuple(engine.models), engine.faults)
    return (*moved, *thought, engine.recording.enabled, engine.recording.file)


def connections(client: Client) -> tuple[str, ...]:
    """Who is connected to the rig."""
    said = client.status().rig
    assert said is not None
    return said.connections


def motion(client: Client) -> MotionStatus:
    """What the joints do."""
    said = client.status().rig
    assert said is not None
    return said.motion


@dataclass
class Watch:
    """The state before, and everything the witness hears until `unharmed`."""

    service: Secured
    operator: Client
    witness: Client

    def __post_init__(self) -> None:
        self.before = state(self.operator.status())
        self.stream = self.witness.watch()
        comes = "wall connected (images)"
        before = self.service.rig.log.count(comes)
        self.pictures = self.witness.images()
        until(lambda: connections(self.operator).count("wall") == 2, 10, "the witness does not watch")
        until(lambda: self.service.rig.log.count(comes) > before, 10, "the log does not name the witness")
        self.log_begins = [len(process.log) for process in self.service.processes]
        assert not self.before[1], "the joints are at rest"

    @property
    def new_log(self) -> str:
        """What the processes have said since."""
        return "".join(p.log[begin:] for p, begin in zip(self.service.processes, self.log_begins, strict=True))

    def unharmed(self) -> None:
        """The rig is as it was, its log names nobody who did anything, and the witness heard nothing but the rig."""
        status = self.operator.status()
        assert state(status) == self.before
        assert sorted(status.alive) == ["engine", "rig"]
        assert OWNER not in self.new_log
        assert "Traceback" not in self.new_log
        heard = list(iter(lambda: self.stream.receive(0), None))
        assert not {received.topic for received in heard} & ENGINE_SAYS
        lines = [received.message.message for received in heard if isinstance(received.message, LogLine)]
        assert OWNER not in "".join(lines)
        assert (self.stream.unreadable, self.pictures.unreadable) == (0, 0)

    def hears(self) -> bool:
        """Whether the witness hears read-backs and pictures: it is not deaf."""
        return bool(self.stream.receive(0)) and bool(self.pictures.receive(0))


@pytest.fixture
def watch(service: Secured) -> Iterator[Watch]:
    with service.client("op") as operator, service.client("wall") as witness:
        began = Watch(service, operator, witness)
        yield began
        began.unharmed()


def try_it(watch: Watch, name: str, attack: Attack) -> None:
    """Let `name` in at every door, attack, and wait until its link has gone: all that it sent has arrived then."""
    for process, endpoint, session_name in watch.service.doors:
        gone = f"{name} disconnected ({session_name})"
        before = process.log.count(gone)
        session = rogue(endpoint, watch.service.keys / "ca.pem", watch.service.keys / f"{name}.pem")
        until(lambda p=process, s=session_name: f"{name} connected ({s})" in p.log, 10, "it is let in")  # type: ignore[misc]
        declared = attack(session)
        end(session)
        until(lambda p=process, g=gone, n=before: p.log.count(g) > n, 10, "its link does not go")  # type: ignore[misc]
        del declared
    watch.unharmed()


def asks(key: str, **fields: Any) -> Attack:
    """A query with a JSON payload under `viewsep/`, to everybody."""
    payload = json.dumps(fields).encode()
    return lambda session: answers(session, f"viewsep/{key}", payload, timeout=0.3)


def remote(call: str, **fields: Any) -> Attack:
    """A call of the rig's interfaces, well made, as the engine's."""
    return lambda session: asks(f"bench/rig/{call}", caller=uuid.uuid4().hex, number=0, holder=OWNER, **fields)(session)


def forge(session: zenoh.Session) -> None:
    """Publish in the name of the rig and its engine, readable and not."""
    for topic in STREAMS:
        said = Log(message=OWNER, name=OWNER).SerializeToString() if topic == LOG else to_bytes(FORGED)
        for payload in (said, b"\xff"):
            session.put(f"viewsep/bench/{topic}", payload, attachment=attachment(7, 7))
    session.put("viewsep/bench/camera/image", b"\xff", attachment=attachment(7, 7))
    for key in ("cmd/stop", "cmd/start", "rig/stop", "status"):
        session.put(f"viewsep/bench/{key}", json.dumps({"owner": OWNER}))


def forge_widely(session: zenoh.Session) -> None:
    """Publish on wildcards that stand for all of it."""
    for key in ("viewsep/bench/*", "viewsep/*/percept", "viewsep/*/result", "viewsep/bench/**", "viewsep/**", "**"):
        session.put(key, to_bytes(FORGED), attachment=attachment(7, 7))
        session.delete(key)


FORBIDDEN: dict[str, tuple[str, Attack]] = {}
for who in ("view", "gone"):
    FORBIDDEN |= {
        f"{who} starts a task": (who, asks("bench/cmd/start", owner=OWNER)),
        f"{who} stops": (who, asks("bench/cmd/stop", owner=OWNER)),
        f"{who} drives home": (who, asks("bench/cmd/home", owner=OWNER)),
        f"{who} moves": (who, asks("bench/cmd/move", owner=OWNER, joints_deg=[3.0, 4.0])),
        f"{who} switches recording off": (who, asks("bench/cmd/record", owner=OWNER, enabled=False)),
        f"{who} asks for every command": (who, asks("bench/cmd/*", owner=OWNER)),
        f"{who} commands all rigs": (who, asks("*/cmd/stop", owner=OWNER)),
        f"{who} asks for everything": (who, asks("**", owner=OWNER)),
    }
for who in ("view", "gone", "op"):
    FORBIDDEN |= {
        f"{who} publishes": (who, forge),
        f"{who} publishes on wildcards": (who, forge_widely),
        f"{who} takes the rig": (who, remote("acquire")),
        f"{who} moves it": (who, remote("move_to", position_rad=[0.1, 0.2])),
        f"{who} stops it": (who, remote("stop")),
        f"{who} calls all rigs": (who, asks("*/rig/*", caller="a", number=0, holder=OWNER)),
        f"{who} acquires all rigs": (who, asks("*/rig/acquire", caller="b", number=0, holder=OWNER)),
    }


@pytest.mark.parametrize("what", FORBIDDEN)
def test_what_is_forbidden_changes_nothing(watch: Watch, what: str) -> None:
    name, attack = FORBIDDEN[what]
    try_it(watch, name, attack)


def test_the_witness_is_not_deaf_and_nobody_is_left(watch: Watch) -> None:
    until(watch.hears, 10, "it hears nothing")
    expected = ["op", "wall", "wall", *(["engine"] if len(watch.service.processes) == 2 else [])]
    until(lambda: sorted(connections(watch.operator)) == sorted(expected), 10, "others are there")


def test_an_engine_may_do_what_others_may_not(service: Secured) -> None:
    """The attacks are well made: with the certificate of an engine they do what they say."""
    with service.client("op") as operator, service.client("wall") as witness:
        watch = Watch(service, operator, witness)
        session = rogue(service.rig.endpoint, service.keys / "ca.pem", service.keys / "engine.pem")
        remote("acquire")(session)
        assert motion(operator).holder == OWNER
        remote("move_to", position_rad=[0.1, 0.2])(session)
        until(lambda: state(operator.status())[0] != watch.before[0], 10, "the joints do not move")
        remote("release")(session)
        forge(session)
        heard: set[str] = set()

        def hears_all() -> bool:
            received = watch.stream.receive(0.1)
            if received is not None and OWNER in repr(received):
                heard.add(received.topic)
            return {"result", LOG} <= heard

        until(hears_all, 10, "the forged messages are not heard")
        assert watch.stream.unreadable > 0
        end(session)
        until(lambda: not motion(operator).moving, 20, "no rest")


@pytest.mark.parametrize("name", ["view", "gone", "op"])
def test_nobody_else_answers_for_the_rig(watch: Watch, name: str) -> None:
    asker = rogue(watch.service.rig.endpoint, watch.service.keys / "ca.pem", watch.service.keys / "op.pem")

    def pose(session: zenoh.Session) -> list[Any]:
        spoofed = [
            session.declare_queryable(f"viewsep/{key}", lambda query: query.reply(query.key_expr, OWNER))
            for key in ("bench/status", "bench/manifest", "bench/cmd/start", "bench/rig/state", "*/status", "**")
        ]
        tokens = [
            session.liveliness().declare_token(f"viewsep/{key}")
            for key in ("ghost/alive/rig", "ghost/alive/engine", "bench/alive/ghost")
        ]
        for _ in range(10):  # long enough for the declarations to arrive
            replies = [reply.ok for reply in asker.get("viewsep/bench/status", timeout=1.0, **ASK)]
            assert len(replies) == len(watch.service.processes)
            assert all(json.loads(ok.payload.to_bytes())["name"] == "bench" for ok in replies if ok)
        seen = rigs((watch.service.rig.endpoint,), str(watch.service.keys), "op")
        assert [(rig.name, rig.roles) for rig in seen] == [("bench", ("engine", "rig"))]
        return [spoofed, tokens]

    try_it(watch, name, pose)
    end(asker)


def test_a_viewer_cannot_hold_a_lease(watch: Watch) -> None:
    token = uuid.uuid4().hex

    def hold(session: zenoh.Session) -> list[Any]:
        lease = session.liveliness().declare_token(f"viewsep/bench/lease/{token}")
        with pytest.raises(RequestRefused, match="there is no liveliness token of that name") as refusal:
            watch.operator.request("start", {"token": token})
        assert refusal.value.code == Code.BAD_REQUEST
        return [lease]

    try_it(watch, "view", hold)


@pytest.mark.parametrize("who", ["no certificate", "wrong CA", "own CA", "expired", "plain TCP"])
def test_strangers_are_not_let_in(watch: Watch, other: Path, who: str) -> None:
    authority: Path | None = watch.service.keys / "ca.pem"
    certificate: Path | None = {
        "wrong CA": other / "op.pem",
        "own CA": other / "op.pem",
        "expired": watch.service.keys / "late.pem",
    }.get(who)
    if who == "own CA":
        authority = other / "ca.pem"
    before = connections(watch.operator)
    for _, endpoint, _ in watch.service.doors:
        if who == "plain TCP":
            endpoint, authority = f"tcp/{endpoint.split('/', 1)[1]}", None
        with pytest.raises(zenoh.ZError):
            rogue(endpoint, authority, certificate)
    assert connections(watch.operator) == before
    assert " connected (" not in watch.new_log
    watch.unharmed()


def test_an_operator_carries_out_a_task_that_a_viewer_sees_and_cannot_end(service: Secured) -> None:
    with service.client("wall") as witness, witness.watch() as stream:
        typed = ["start", "--wait", "--seed", "1", "--json", "--connect", service.rig.endpoint]
        typed += ["--keys", str(service.keys), "--as", "op"]
        task = subprocess.Popen([sys.executable, "-m", "viewsep", *typed], stdout=subprocess.PIPE, text=True)
        assert task.stdout is not None
        until(lambda: witness.status().engine.task, 20, "no task")  # type: ignore[union-attr]
        session = rogue(service.rig.endpoint, service.keys / "ca.pem", service.keys / "view.pem")
        attacks = iter([*(asks(f"bench/cmd/{name}", owner=OWNER) for name in ("stop", "cancel", "home")), forge] * 5)

        def ended_under_attack() -> bool:
            for attack in attacks:
                attack(session)
                break
            return task.poll() is not None

        until(ended_under_attack, 120, "the task does not end")
        said = json.loads(task.stdout.read())
        task.stdout.close()
        end(session)
        seen = witness.status()
        heard: list[Received] = []

        def heard_the_end() -> bool:
            heard.extend(iter(lambda: stream.receive(0), None))
            return "result" in {received.topic for received in heard}

        until(heard_the_end, 10, "no result is heard")
        with witness.images() as pictures:
            assert pictures.receive(10) is not None
    assert task.returncode == TO_THE_END[said["outcome"]]
    assert seen.engine is not None
    assert seen.engine.result is not None
    assert seen.engine.result.task == said["task"]
    results = [received.message for received in heard if received.topic == "result"]
    assert [result.reason for result in results if isinstance(result, Result)] == [said["reason"]]
    assert {received.topic for received in heard} == set(STREAMS)
    assert OWNER not in repr(heard)
    assert stream.unreadable == 0
    assert OWNER not in service.log


@pytest.mark.parametrize("typed", [("stop",), ("home",), ("start",), ("move", "--joints", "1,2"), ("cancel",)])
def test_a_viewer_is_told_in_one_sentence(watch: Watch, typed: tuple[str, ...]) -> None:
    ended = watch.service.command("view", *typed, "--rig", "bench", "--timeout", "1")
    assert ended.returncode == 1
    assert re.fullmatch(r"viewsep: no answer from tls/.*: not running, or not allowed\n", ended.stderr)
    assert ended.stdout == ""


def test_who_was_revoked_is_told_in_one_sentence(watch: Watch) -> None:
    with pytest.raises(NoAnswer, match=r"no answer from .*: not running, or not allowed"):
        watch.service.rig.client(keys=str(watch.service.keys), certificate="gone", timeout_s=0.5).__enter__().status()


def test_a_viewer_sees_the_status(service: Secured) -> None:
    ended = service.command("view", "status", "--json")
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["alive"] == ["engine", "rig"]
    assert "view connected (control)" in service.rig.log
