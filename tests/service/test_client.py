"""The client against a service made of bytes, well-behaved and not."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import zenoh
from fake_service import (
    FakeService,
    accept,
    fake_service,
    later,
    raw,
    raw_error,
    refuse,
    result,
    say,
    silent,
    until,
)
from foxglove_schemas_protobuf.Log_pb2 import Log
from ports import free_port

from viewsep.client import BadReply, Client, LogLine, NoAnswer, Received, RequestRefused, ServedRig, TaskLost, rigs
from viewsep.errors import BadInput, NotConnected, RigError, Timeout, ViewsepError
from viewsep.messages import Frame, JointState, Outcome, Result
from viewsep.recordings.codec import encode_frame, serialise, to_bytes

ENDED = Result(7, Outcome.UNDECIDED, "", "too many looks", (("tea", 1.0),), np.eye(3), 9, 1.0, 3)


@pytest.fixture
def service() -> Iterator[FakeService]:
    with fake_service() as served:
        yield served


@pytest.fixture
def client(service: FakeService) -> Iterator[Client]:
    with Client("bench", (service.endpoint,), "ana", timeout_s=0.5) as opened:
        yield opened


def test_the_status_is_typed(client: Client) -> None:
    status = client.status()
    assert status.rig is not None
    assert status.engine is not None
    assert [joint.position_deg for joint in status.rig.motion.joints] == [10.0, -20.0]
    assert status.engine.candidates[0].name == "tea"
    assert status.alive == ("engine", "rig")


def test_a_status_in_two_parts_is_put_together() -> None:
    with (
        fake_service(roles=("rig",)) as rig,
        fake_service(roles=("engine",), connect=rig.endpoint),
        Client("bench", (rig.endpoint,), timeout_s=2) as client,
    ):
        until(lambda: "engine" in client.status().alive, "the engine is not seen through the rig")
        status = client.status()
        assert status.rig is not None
        assert status.engine is not None
        assert sorted(client.manifest()["roles"]) == ["engine", "rig"]
        assert client.start() == "t1"
        assert rigs((rig.endpoint,)) == [ServedRig("bench", ("engine", "rig"))]


def test_the_only_rig_is_found_and_several_are_listed() -> None:
    with fake_service("arm") as arm, Client(connect=(arm.endpoint,)) as client:
        assert client.rig == "arm"
        with fake_service("bench", connect=arm.endpoint):
            until(lambda: len(rigs((arm.endpoint,))) == 2, "the second rig is not seen")
            with pytest.raises(BadInput, match=r"several rigs at .*: name arm or bench"):
                Client(connect=(arm.endpoint,)).open()


def test_another_rig_than_the_one_there_is_bad_input(service: FakeService) -> None:
    with (
        Client("crane", (service.endpoint,)) as client,
        pytest.raises(BadInput, match=r"no rig 'crane' at .*: .* bench"),
    ):
        client.status()


def test_nobody_there() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(NoAnswer, match=f"no answer from {endpoint}.*: not running, or not allowed") as silence:
        Client("bench", (endpoint,), timeout_s=0.2).open()
    assert silence.value.exit_code == 1


def test_a_service_that_hangs_is_no_answer(service: FakeService, client: Client) -> None:
    service.handlers["status"] = silent(service)
    with pytest.raises(NoAnswer, match=r"no answer from tcp/.* for rig 'bench' within 0\.5 s: not running, or not"):
        client.status()


@pytest.mark.parametrize(
    ("handler", "words"),
    [
        (raw(b""), "not JSON"),
        (raw(b"{"), "not JSON"),
        (raw(b"\xff\xfe"), "not JSON"),
        (raw(b"[" * 100_000), "not JSON"),
        (raw(b"[]"), "not a JSON object"),
        (raw(b"{}"), "is None, but this client reads 'viewsep.status/1': update"),
        (raw(b'{"schema": "viewsep.status/2"}'), "is 'viewsep.status/2', but"),
        (raw(b'{"schema": "viewsep.status/1", "name": 7}'), "cannot be read, field 'name': .*; update viewsep"),
        (raw_error(b"oops"), "not JSON"),
        (raw_error(b'{"code": 7}'), "has no code and message"),
    ],
)
def test_a_damaged_answer_is_one_sentence(service: FakeService, client: Client, handler: Any, words: str) -> None:
    service.handlers["status"] = handler
    with pytest.raises(BadReply, match=words) as error:
        client.status()
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("code", "exit_code"), [("busy", 1), ("fault", 1), ("unknown_model", 2), ("bad_request", 2), ("of_the_future", 1)]
)
def test_a_refusal_keeps_code_and_sentence(service: FakeService, client: Client, code: str, exit_code: int) -> None:
    service.handlers["cmd/start"] = refuse(code, "not now, [please]")
    with pytest.raises(RequestRefused, match=r"not now, \[please\]") as refusal:
        client.start()
    assert (refusal.value.code, refusal.value.exit_code) == (code, exit_code)
    until(lambda: not service.tokens, "the token of what was refused is still there")


def test_an_attached_task_is_held_by_a_token_until_it_ends(service: FakeService, client: Client) -> None:
    task = client.start(("tea", "decaf"), seed=3)
    command, request = service.requests[-1]
    assert (command, task) == ("start", "t1")
    assert request | {"token": ""} == {"owner": "ana", "candidates": ["tea", "decaf"], "seed": 3, "token": ""}
    until(lambda: service.tokens == {request["token"]}, "the token is not seen")
    service.end_task("t1")
    assert client.wait("t1", 5).object == "tea"
    until(lambda: not service.tokens, "the token is still seen")


def test_a_client_that_closes_lets_go(service: FakeService) -> None:
    with Client("bench", (service.endpoint,)) as client:
        client.start()
        until(lambda: service.tokens, "no token")
    until(lambda: not service.tokens, "the token is still seen")


def test_a_detached_task_has_no_token(service: FakeService, client: Client) -> None:
    client.start(detach=True)
    assert service.requests[-1][1]["token"] == ""
    assert client.status().engine is not None
    assert not service.tokens


def test_a_late_result_is_waited_for_and_messages_are_heard(service: FakeService, client: Client) -> None:
    task = client.start()
    heard: list[Received] = []

    def finish() -> None:
        until(lambda: service.watched("result"), "nobody listens")
        service.publish("result", to_bytes(ENDED))
        until(lambda: heard, "the result is not heard")
        service.end_task(task, "undecided", None)

    thread = later(finish)
    ended = client.wait(task, 10, heard.append)
    thread.join()
    assert (ended.task, ended.outcome, ended.object) == (task, "undecided", None)
    assert [type(received.message) for received in heard] == [Result]


def test_the_published_result_counts_when_the_service_ends_with_the_task(service: FakeService, client: Client) -> None:
    task = client.start()
    heard: list[Received] = []

    def finish() -> None:
        until(lambda: service.watched("result"), "nobody listens")
        service.handlers["status"] = count_then(service, 2)
        until(lambda: "asked" in service.status, "nobody asks")
        service.publish("result", to_bytes(ENDED))
        until(lambda: heard, "the result is not heard")
        service.close()

    thread = later(finish)
    ended = client.wait(task, 20, heard.append)
    thread.join()
    assert (ended.task, ended.outcome, ended.reason, ended.recording) == (task, "undecided", "too many looks", None)


def count_then(service: FakeService, number: int) -> Callable[[zenoh.Query, Any], None]:
    """Answers, and notes in the status when it has done so `number` times."""
    times: list[int] = []

    def answer(query: zenoh.Query, _request: Any) -> None:
        say(query, service.status)
        times.append(1)
        if len(times) >= number:
            service.status["asked"] = True

    return answer


def test_a_service_that_goes_away_ends_the_wait(service: FakeService, client: Client) -> None:
    task = client.start()

    def go() -> None:
        until(lambda: service.watched("result"), "nobody listens")
        service.close()

    thread = later(go)
    with pytest.raises(NoAnswer, match="the service went away while task t1 ran"):
        client.wait(task, 30)
    thread.join()


def test_an_unknown_task_ends_the_wait(client: Client) -> None:
    with pytest.raises(TaskLost, match="task t9 is not known any more"):
        client.wait("t9", 30)


def test_a_wait_has_a_deadline(client: Client) -> None:
    task = client.start()
    with pytest.raises(Timeout, match=r"task t1 has not ended within 0\.3 s and goes on"):
        client.wait(task, 0.3)


def test_stop_says_who_did_not_answer(service: FakeService, client: Client) -> None:
    stopped = client.stop("smoke")
    assert (stopped.roles, stopped.silent) == (("engine", "rig"), ())
    assert service.requests[-1] == ("stop", {"owner": "ana", "reason": "smoke"})
    with (
        fake_service(roles=("rig",)) as alone,
        fake_service(roles=("engine",), connect=alone.endpoint) as hung,
        Client("bench", (alone.endpoint,), timeout_s=0.5) as other,
    ):
        hung.handlers["cmd/stop"] = silent(hung)
        until(lambda: "engine" in other.status().alive, "the engine is not seen")
        stopped = other.stop()
        assert (stopped.roles, stopped.silent) == (("rig",), ("engine",))
        alone.handlers["cmd/stop"] = refuse("fault", "the bus is broken")
        with pytest.raises(RequestRefused, match="the bus is broken"):
            other.stop()


def test_moves_settle_or_say_why_not(service: FakeService, client: Client) -> None:
    client.settle(client.move(joints_deg=(10, -20), detach=False), 5)
    assert {"joints_deg": [10, -20]}.items() <= service.requests[-1][1].items()
    until(lambda: not service.tokens, "the token is still seen")
    service.motion["moving"] = True
    with pytest.raises(Timeout):
        client.settle(client.home(), 0.2)
    service.motion["moving"] = False
    with pytest.raises(RigError, match=r"stand still at 10\.0, -20\.0 deg instead of 0\.0, 0\.0 deg: .*stopped"):
        client.settle((0.0, 0.0), 30)
    service.motion["fault"] = "pan is hot"
    with pytest.raises(RigError, match="pan is hot"):
        client.settle((10.0, -20.0), 5)
    with pytest.raises(BadInput, match="not both"):
        client.move()


def test_the_other_requests_say_what_was_asked(service: FakeService, client: Client) -> None:
    client.cancel("lunch")
    client.clear_fault()
    client.learn("meshes/tea", "tea")
    client.record(False)
    assert service.requests == [
        ("cancel", {"owner": "ana", "reason": "lunch"}),
        ("clear_fault", {"owner": "ana"}),
        ("learn", {"owner": "ana", "source": "meshes/tea", "name": "tea"}),
        ("record", {"owner": "ana", "enabled": False}),
    ]


def test_an_acceptance_without_its_fields_is_a_bad_reply(service: FakeService, client: Client) -> None:
    service.handlers["cmd/start"] = lambda query, _: accept(query)
    with pytest.raises(BadReply, match="no 'task'"):
        client.start()
    until(lambda: not service.tokens, "the token is still seen")


def test_streams_are_decoded_and_gaps_counted(service: FakeService, client: Client) -> None:
    state = JointState(5, (0.1,), (0.2,), True)
    with client.watch() as stream:
        until(lambda: service.watched("motion/state") and service.watched("log"), "nobody listens")
        service.publish("motion/state", to_bytes(state))
        service.publish("motion/state", to_bytes(state), skip=3)
        service.publish("motion/state", b"\xff\xff")
        service.publish("motion/state", to_bytes(state), attachment=b"short")
        service.publish("log", Log(level=Log.WARNING, name="rig", message="warm").SerializeToString())
        received = [stream.receive(5) for _ in range(3)]
        assert stream.receive(0) is None
    found = {(r.topic, r.sequence, r.stamp_ns) for r in received if r}
    assert found == {("motion/state", 0, 1001), ("motion/state", 4, 1002), ("log", 0, 1005)}
    assert {type(r.message) for r in received if r} == {JointState, LogLine}
    assert (stream.gaps, stream.unreadable) == (3, 2)
    assert list(stream) == []


def test_pictures_are_the_newest_ones(service: FakeService, client: Client) -> None:
    picture = encode_frame(Frame(9, 0, np.full((8, 8, 3), 200, np.uint8), None))[0][1]
    with client.images((service.endpoint,)) as pictures:
        until(lambda: service.watched("camera/image"), "nobody listens")
        assert pictures.receive(0) is None
        service.publish("camera/image", serialise(picture))
        first = pictures.receive(5)
        for _ in range(10):
            service.publish("camera/image", serialise(picture))
        later_ones = [frame.sequence for frame in iter(lambda: pictures.receive(0.5), None)]
    assert first is not None
    assert first.decode().image.shape == (8, 8, 3)
    assert first.stamp_ns == 9
    assert later_ones[-1] == 10
    assert len(later_ones) + pictures.dropped == 10


def test_a_closed_client_leaves_no_thread_and_says_so(service: FakeService) -> None:
    before = threading.active_count()
    client = Client("bench", (service.endpoint,))
    with client:
        client.start()
        client.watch()
        client.images((service.endpoint,))
        client.status()
    assert threading.active_count() == before
    client.close()
    with pytest.raises(NotConnected, match="this client is closed"):
        client.status()


def test_bad_names_and_streams(client: Client) -> None:
    for name in ("*", "a/b", ""):
        with pytest.raises(BadInput, match="a rig's name has"):
            Client(name).open()
    with pytest.raises(BadInput, match="no stream 'camera/image'"):
        client.watch(("camera/image",))
    with pytest.raises(ViewsepError, match="no rig yet"):
        _ = Client().rig


def test_a_result_says_what_the_status_says(service: FakeService, client: Client) -> None:
    service.status["engine"] |= {"task": "t1"}
    more = {"indistinct": ["tea", "decaf"], "telling_view_deg": [90.0, -85.0], "pose_spread_deg": 4.5}
    service.end_task("t1", "indistinguishable", None, **more)
    assert client.wait("t1", 5).model_dump(mode="json") == result("t1", "indistinguishable", None, **more)


def test_a_result_of_an_older_service_lacks_what_it_did_not_know(service: FakeService, client: Client) -> None:
    service.status["engine"] |= {"task": "t1"}
    service.end_task("t1")
    for name in ("indistinct", "telling_view_deg", "pose_spread_deg"):
        del service.engine["result"][name]
    ended = client.wait("t1", 5)
    assert (ended.object, ended.indistinct, ended.telling_view_deg, ended.pose_spread_deg) == ("tea", (), None, None)
