"""Real Zenoh sessions against a served rig. What counts is what the serving side saw, not what a client believes."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from ports import free_port
from served_rig import ServedRig, answers, end, make_keys, rogue, sign_again, until

from viewsep.config import ServiceConfig
from viewsep.errors import BadConfig, BadInput
from viewsep.keys import KeyRole, init_keys, issue
from viewsep.service.transport import MAX_MESSAGE_BYTES, Connections, NoAnswer, client_session, serving_session

STREAMS = ("camera/image", "motion/state", "percept", "event", "command", "estimate", "result", "log")
FORBIDDEN_PUTS = (
    "viewsep/x/percept",
    "viewsep/x/cmd/stop",
    "viewsep/x/rig/move",
    "viewsep/*/percept",
    "viewsep/**",
    "**",
)
FORBIDDEN_QUERIES = ("viewsep/x/rig/move", "viewsep/x/*", "viewsep/x/cmd/**", "viewsep/**", "**")
FORBIDDEN_TOKENS = ("viewsep/x/alive/rig", "viewsep/x/alive/engine", "viewsep/**")
SPOOFED = ("viewsep/x/status", "viewsep/x/cmd/stop", "viewsep/x/rig/move", "viewsep/**")


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_keys(tmp_path_factory.mktemp("security") / "keys")


@pytest.fixture(scope="module")
def served(keys: Path) -> Iterator[ServedRig]:
    rig = ServedRig(keys, f"tls/127.0.0.1:{free_port()}")
    yield rig
    rig.close()


@pytest.fixture
def rig(served: ServedRig) -> ServedRig:
    until(lambda: not served.connections.names, "nobody is connected")
    served.saw.clear()
    served.links.clear()
    return served


def attack(session: zenoh.Session) -> list[Any]:
    """Say everything that only a rig may say."""
    for key in FORBIDDEN_PUTS:
        session.put(key, "false")
        session.delete(key)
    for key in FORBIDDEN_QUERIES:
        session.get(key, payload="go", timeout=0.2, target=zenoh.QueryTarget.ALL)
    tokens = [session.liveliness().declare_token(key) for key in FORBIDDEN_TOKENS]
    return [*tokens, *(session.declare_queryable(key, pose_as_rig) for key in SPOOFED)]


def pose_as_rig(query: zenoh.Query) -> None:
    query.reply(query.key_expr, "false")


def command(session: zenoh.Session) -> list[str]:
    return answers(session, "viewsep/x/cmd/stop", b"{}", timeout=0.5)


def test_the_attack_works_where_nothing_is_denied() -> None:
    rig = ServedRig(None, f"tcp/127.0.0.1:{free_port()}")
    session = rogue(rig.endpoint)
    declared = attack(session)
    until(lambda: "false" in rig.asked("viewsep/x/status"), "a client poses as the rig")
    (name,) = rig.connections.names
    saw = {(what, key) for what, key, _ in rig.after(session, name)}
    assert {("put", key) for key in FORBIDDEN_PUTS if key != "**"} <= saw
    assert {("delete", key) for key in FORBIDDEN_PUTS if key != "**"} <= saw
    assert {("query", "viewsep/x/rig/move"), ("query", "viewsep/**"), ("query", "**")} <= saw
    # the rig has a token of that name itself, so the false one shows when it goes, which may be after the link has gone
    until(lambda: ("token", "viewsep/x/alive/rig", 0) in rig.saw, "a false sign of life is seen")
    assert declared
    rig.close()


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
@pytest.mark.parametrize("name", ["op", "view", "gone"])
def test_only_rigs_and_engines_speak_for_a_rig(rig: ServedRig, keys: Path, name: str, mode: str) -> None:
    session = rogue(rig.endpoint, keys / "ca.pem", keys / f"{name}.pem", mode)
    until(lambda: rig.connections.names == (name,), f"{name} is connected")
    declared = attack(session)
    assert declared
    for _ in range(10):  # long enough for the declarations to arrive
        assert rig.asked("viewsep/x/status") == ["the rig"]
        answers(session, "viewsep/x/rig/move", timeout=0.05)
    assert rig.asked("viewsep/x/rig/move") == ["the rig"]
    rig.saw = [entry for entry in rig.saw if entry not in OWN_QUESTIONS]
    assert rig.after(session, name) == []


OWN_QUESTIONS = (("query", "viewsep/x/status", 0), ("query", "viewsep/x/rig/move", 0))


def test_an_operator_asks_and_commands(rig: ServedRig, keys: Path) -> None:
    session = client_session([rig.endpoint], keys, "op", 3.0)
    for key in ("viewsep/x/status", "viewsep/*/status", "viewsep/x/manifest"):
        assert answers(session, key) == ["the rig"]
    assert command(session) == ["the rig"]
    lease = session.liveliness().declare_token("viewsep/x/lease/abc")
    until(lambda: ("token", "viewsep/x/lease/abc", 0) in rig.saw, "the rig sees the lease")
    saw = rig.after(session, "op")
    assert ("query", "viewsep/x/cmd/stop", 2) in saw
    until(lambda: rig.saw.count(("token", "viewsep/x/lease/abc", 0)) == 2, "the rig sees the lease go")
    del lease


def test_a_viewer_asks_but_does_not_command(rig: ServedRig, keys: Path) -> None:
    session = client_session([rig.endpoint], keys, "view", 3.0)
    assert command(session) == []
    lease = session.liveliness().declare_token("viewsep/x/lease/abc")
    for key in ("viewsep/x/status", "viewsep/*/status", "viewsep/x/manifest"):
        assert answers(session, key) == ["the rig"]
    asked = [("query", "viewsep/x/status", 0), ("query", "viewsep/*/status", 0), ("query", "viewsep/x/manifest", 0)]
    assert rig.after(session, "view") == asked
    del lease


def test_a_name_that_was_revoked_gets_and_does_nothing(rig: ServedRig, keys: Path) -> None:
    session = client_session([rig.endpoint], keys, "gone", 3.0)
    until(lambda: rig.connections.names == ("gone",), "gone is connected")
    assert command(session) == []
    assert answers(session, "viewsep/*/status", timeout=0.5) == []
    assert list(session.liveliness().get("viewsep/*/alive/*", timeout=0.5)) == []
    assert rig.after(session, "gone") == []


@pytest.mark.parametrize("name", ["op", "view"])
def test_everybody_in_the_register_sees_streams_and_roles(rig: ServedRig, keys: Path, name: str) -> None:
    session = client_session([rig.endpoint], keys, name, 3.0)
    got: list[str] = []
    subscribers = [
        session.declare_subscriber(f"viewsep/x/{topic}", lambda sample: got.append(str(sample.key_expr)))
        for topic in (*STREAMS, "rig/secret")
    ]

    def heard() -> bool:
        for topic in ("rig/secret", *STREAMS):
            rig.session.put(f"viewsep/x/{topic}", "true")
        return {f"viewsep/x/{topic}" for topic in STREAMS} <= set(got)

    until(heard, "all streams")
    assert "viewsep/x/rig/secret" not in got
    for key in ("viewsep/*/alive/*", "viewsep/x/alive/*"):
        assert [str(reply.ok.key_expr) for reply in session.liveliness().get(key) if reply.ok] == [
            "viewsep/x/alive/rig"
        ]
    end(*subscribers)
    rig.after(session, name)


def test_an_engine_and_its_clients_work_through_the_rig(rig: ServedRig, keys: Path) -> None:
    service = ServiceConfig(keys=str(keys), certificate="engine", listen=(f"tls/127.0.0.1:{free_port()}",))
    engine = serving_session(service, service.listen, [rig.endpoint])
    until(lambda: rig.connections.names == ("engine",), "the engine is connected")
    queryable = engine.declare_queryable("viewsep/x/status", lambda query: query.reply(query.key_expr, "the engine"))
    until(lambda: rig.asked("viewsep/x/status") == ["the engine", "the rig"], "both answer")
    assert answers(engine, "viewsep/x/rig/move") == ["the rig"]
    session = client_session([rig.endpoint], keys, "view", 3.0)
    assert answers(session, "viewsep/*/status") == ["the engine", "the rig"]
    end(queryable, session, engine)
    until(lambda: not rig.connections.names, "all are gone")
    assert rig.links == [("engine", True), ("view", True), ("view", False), ("engine", False)]


def test_whoever_has_no_good_certificate_is_not_let_in(rig: ServedRig, keys: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    init_keys(other)
    issue(other, "op", KeyRole.OPERATOR)
    port = rig.endpoint.rsplit(":", 1)[1]
    for endpoint, authority, certificate in (
        (rig.endpoint, keys / "ca.pem", None),
        (rig.endpoint, keys / "ca.pem", other / "op.pem"),
        (rig.endpoint, other / "ca.pem", other / "op.pem"),
        (rig.endpoint, keys / "ca.pem", keys / "late.pem"),
        (f"tcp/127.0.0.1:{port}", None, None),
    ):
        with pytest.raises(zenoh.ZError):
            rogue(endpoint, authority, certificate)
    session = client_session([rig.endpoint], keys, "op", 3.0)  # the door still works
    assert answers(session, "viewsep/x/status") == ["the rig"]
    assert rig.after(session, "op") == [("query", "viewsep/x/status", 0)]
    assert rig.links == [("op", True), ("op", False)]


def test_a_link_ends_when_its_certificate_does(rig: ServedRig, keys: Path, tmp_path: Path) -> None:
    copy = tmp_path / "keys"
    shutil.copytree(keys, copy)
    sign_again(copy, "op", 2.5 / 86400)
    session = rogue(rig.endpoint, copy / "ca.pem", copy / "op.pem")
    until(lambda: rig.links == [("op", True)], "op is let in")
    until(lambda: rig.links == [("op", True), ("op", False)], "the link ends")
    end(session)


@pytest.mark.parametrize("poser", ["op", "view"])
def test_a_client_certificate_cannot_pose_as_a_rig(keys: Path, poser: str) -> None:
    endpoint = f"tls/127.0.0.1:{free_port()}"
    listener = rogue("", keys / "ca.pem", keys / f"{poser}.pem", "peer", [endpoint])
    links: list[str] = []
    connections = Connections(listener, lambda name, _: links.append(name))
    with pytest.raises(NoAnswer, match=f"no answer from {endpoint}: not running, or not allowed"):
        client_session([endpoint], keys, "op", 0.5)
    assert links == []
    end(connections, listener)


def test_a_message_that_is_too_large_is_lost_and_the_link_stays() -> None:
    rig = ServedRig(None, f"tcp/127.0.0.1:{free_port()}")
    session = client_session([rig.endpoint], None, "", 3.0)
    largest = MAX_MESSAGE_BYTES - 4096
    for size in (largest, MAX_MESSAGE_BYTES, 2 * MAX_MESSAGE_BYTES, 5):
        answers(session, "viewsep/x/cmd/learn", b"x" * size, timeout=0.5 if size >= MAX_MESSAGE_BYTES else 5.0)
    assert rig.saw == [("query", "viewsep/x/cmd/learn", largest), ("query", "viewsep/x/cmd/learn", 5)]
    assert [came for _, came in rig.links] == [True]
    end(session)
    rig.close()


def test_serving_sessions_wait_for_each_other() -> None:
    there = f"tcp/127.0.0.1:{free_port()}"
    early = serving_session(ServiceConfig(), (), [there])
    links: list[bool] = []
    connections = Connections(early, lambda _, came: links.append(came))
    for expected in ([True], [True, False, True]):
        late = serving_session(ServiceConfig(), [there], ())
        until(lambda expected=expected: links == expected, "they find each other")  # type: ignore[misc]
        end(late)
        until(lambda: links[-1] is False, "it is gone")
    end(connections, early)


def test_a_port_in_use_ends_in_one_sentence(keys: Path) -> None:
    port = free_port()
    first = serving_session(ServiceConfig(), [f"tcp/127.0.0.1:{port}"], ())
    with pytest.raises(BadInput, match=rf"cannot listen on tcp/127\.0\.0\.1:{port}: Address already in use; end what"):
        serving_session(ServiceConfig(), [f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{port}"], ())
    with pytest.raises(BadInput, match=rf"cannot listen on tls/127\.0\.0\.1:{port}: Address already in use; end what"):
        serving_session(ServiceConfig(keys=str(keys)), [f"tls/127.0.0.1:{port}"], ())
    end(first)


def test_nobody_there_ends_in_one_sentence() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(NoAnswer, match=f"no answer from {endpoint}: not running, or not allowed") as raised:
        client_session([endpoint], None, "", 0.3)
    assert raised.value.exit_code == 1


def test_without_a_register_nothing_is_served(keys: Path, tmp_path: Path) -> None:
    for name in ("ca.pem", "rig.pem", "rig.key"):
        shutil.copy(keys / name, tmp_path)
    with pytest.raises(BadConfig, match=r"there is no .*register\.json, .*copy it from where the keys are made"):
        serving_session(ServiceConfig(keys=str(tmp_path)), ["tls/127.0.0.1:0"], ())


@pytest.mark.parametrize(("name", "words"), [("op", "'op' is operator in"), ("gone", "'gone' is nobody in")])
def test_only_rigs_and_engines_serve(keys: Path, name: str, words: str) -> None:
    with pytest.raises(BadConfig, match=rf"key 'service.certificate' = {words} .*that is engine, rig"):
        serving_session(ServiceConfig(keys=str(keys), certificate=name), ["tls/127.0.0.1:0"], ())
