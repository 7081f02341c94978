"""What happens when a process dies or stands still, and when a line is cut: real processes, nothing pretended."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cut_line import Line
from processes import (
    Serving,
    answers,
    complete,
    engine_of,
    held,
    rig_of,
    running,
    serving,
    split,
    under_way,
    until,
)

from viewsep.client import Client, RequestRefused
from viewsep.recordings.reader import read_recording
from viewsep.recordings.recovery import recovered_path
from viewsep.recordings.replay import verify
from viewsep.service.status import ResultStatus

ENDS = ("identified", "undecided")
MARGIN_S = 1.5  # for a busy machine
LEASE_S = 2.0
STOPPED_S = 3.0


@pytest.fixture
def short(seed_settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tasks of a few seconds; a move may wait for as long as the rig is out of reach, on a clock that runs fast."""
    return {
        **seed_settings,
        "task": {"max_looks": 40, "move_timeout_s": 200.0},
        "camera": {"rate_hz": 8.0, "size_px": 64},
    }


def say(what: str, seconds: float) -> None:
    """A figure for people (`pytest -s`)."""
    print(f"\n{what}: {seconds:.2f} s", end="", flush=True)  # noqa: T201


@contextmanager
def both(*services: Serving) -> Iterator[tuple[Client, ...]]:
    """The services, started, and a client of each; all roles see each other."""
    with serving(*services):
        clients = [service.client() for service in services]
        for client in clients:
            client.open()
        until(lambda: all(len(c.status().alive) == 2 for c in clients), 20, "the roles do not see each other")
        try:
            yield tuple(clients)
        finally:
            for client in clients:
                client.close()


def task_works(client: Client, folder: Path) -> ResultStatus:
    """Carry out a task to its end."""
    result = client.wait(client.start(seed=3), timeout_s=60)
    assert result.outcome in ENDS, result.reason
    assert engine_of(client).recording.lost == 0
    complete(result, folder)
    return result


def test_an_engine_that_is_killed_leaves_a_rig_that_holds(short: Mapping[str, Any], tmp_path: Path) -> None:
    rig, engine = split(short, tmp_path)
    with both(rig, engine) as (client, _):
        client.start(seed=1, detach=True)
        under_way(client)
        engine.end(signal.SIGKILL)
        say("engine killed, rig holds after", held(client, LEASE_S + MARGIN_S))
        status = client.status()
        assert status.alive == ("rig",)
        assert status.engine is None
        (left,) = (tmp_path / "recordings").glob("*.part")
        again = Serving(tmp_path / "engine2", engine.settings, engine.arguments)
        with serving(again):
            until(lambda: client.status().engine, 10, "the new engine is not there")
            saved = recovered_path(left)
            until(saved.exists, 10, "what was recorded is not saved by itself")
            verify(read_recording(saved))
            until(lambda: "saved in" in " ".join(again.log.split()), 5, "it is not said")
            left.unlink()
            task_works(client, again.folder)


def test_a_rig_that_is_killed_fails_the_task_and_the_next_one_works(short: Mapping[str, Any], tmp_path: Path) -> None:
    rig, engine = split(short, tmp_path, resume_s=2.0)
    with both(rig, engine) as (_, client):
        task = client.start(seed=1)
        under_way(client)
        rig.end(signal.SIGKILL)
        begun = time.monotonic()
        assert client.status().rig is None
        result = client.wait(task, timeout_s=20)
        say("rig killed, task failed after", time.monotonic() - begun)
        assert result.outcome == "failed"
        assert "has not answered for 2 s" in result.reason
        complete(result, engine.folder)
        assert not engine_of(client).link.up
        with pytest.raises(RequestRefused, match="the rig is not there") as lost:
            client.start()
        assert lost.value.code == "rig_lost"
        again = Serving(tmp_path / "rig2", rig.settings, rig.arguments, port=rig.port, image_port=rig.image_port)
        with serving(again):
            until(lambda: client.status().rig, 10, "the new rig is not seen")
            task_works(client, engine.folder)


def test_a_detached_task_goes_on_without_its_client(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, short)
    with serving(service), service.client() as client:
        script = (
            "from viewsep.client import Client; import time\n"
            f"c = Client('bench', connect=('{service.endpoint}',), owner='ana').__enter__()\n"
            "print(c.start(seed=1, detach=True), flush=True); time.sleep(60)\n"
        )
        with running(script) as owner:
            assert owner.stdout is not None
            task = owner.stdout.readline().strip()
            under_way(client)
            owner.kill()
        result = client.wait(task, timeout_s=60)
        assert result.outcome in ENDS, result.reason
        complete(result, service.folder)


@pytest.mark.parametrize("frozen", ["rig", "engine"])
def test_a_process_that_stands_still_is_waited_for(short: Mapping[str, Any], tmp_path: Path, frozen: str) -> None:
    services = split(short, tmp_path, lease_s=LEASE_S)
    with both(*services) as clients:
        other, process = clients[frozen == "rig"], services[frozen != "rig"]
        task = other.start(seed=1)
        under_way(other)
        process.send(signal.SIGSTOP)
        begun = time.monotonic()
        other.timeout_s = 0.5  # the one that stands still does not answer
        if frozen == "engine":
            say("engine stands still, rig holds after", held(other, LEASE_S + MARGIN_S))
        while time.monotonic() < begun + STOPPED_S:
            assert answers(other)
        process.send(signal.SIGCONT)
        other.timeout_s = 2.0
        result = other.wait(task, timeout_s=60)
        assert result.outcome in ENDS, result.reason
        complete(result, services[1].folder)
        assert engine_of(other).recording.lost == 0


def test_a_viewer_that_stands_still_slows_nobody_down(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, short)
    with serving(service), service.client() as client:
        script = (
            "from viewsep.client import Client\n"
            f"c = Client('bench', connect=('{service.endpoint}',)).__enter__()\n"
            f"pictures = c.images(('tcp/127.0.0.1:{service.image_port}',)); stream = c.watch()\n"
            "next(iter(pictures)); print('sees', flush=True)\n"
            "while True: pictures.receive(0.02); stream.receive(0.02)\n"
        )
        with running(script) as viewer:
            assert viewer.stdout is not None
            assert viewer.stdout.readline() == "sees\n"
            task = client.start(seed=1)
            under_way(client)
            viewer.send_signal(signal.SIGSTOP)
            begun, looks = time.monotonic(), engine_of(client).looks
            until(lambda: engine_of(client).looks > looks + 10 or not engine_of(client).task, 5, "no looks any more")
            slowest_s = 0.0
            while time.monotonic() < begun + STOPPED_S:
                asked = time.monotonic()
                assert answers(client)
                slowest_s = max(slowest_s, time.monotonic() - asked)
            say("slowest answer beside a viewer that stands still", slowest_s)
            viewer.send_signal(signal.SIGCONT)
            result = client.wait(task, timeout_s=60)
            assert viewer.poll() is None
        assert result.outcome in ENDS, result.reason
        complete(result, service.folder)
        assert engine_of(client).recording.lost == 0


@pytest.mark.parametrize("cut_s", [1.0, 4.5])
def test_a_line_between_engine_and_rig_that_is_cut(short: Mapping[str, Any], tmp_path: Path, cut_s: float) -> None:
    rig, engine = split(short, tmp_path, lease_s=0.5, resume_s=2.5)
    line = Line(rig.endpoint)
    engine.settings = {**engine.settings, "service": {**engine.settings["service"], "connect": [line.endpoint]}}
    try:
        with both(rig, engine) as (near, far):
            task = near.start(seed=1)  # attached through the rig: its owner is out of the engine's sight as well
            under_way(near)
            line.cut()
            begun = time.monotonic()
            say("line cut, rig holds after", held(near, 0.5 + MARGIN_S))
            time.sleep(max(0.0, begun + cut_s - time.monotonic()))
            line.mend()
            result = far.wait(task, timeout_s=60)
            complete(result, engine.folder)
            if cut_s < 2.5:
                assert result.outcome in ENDS, result.reason
                assert engine_of(far).recording.lost == 0
            else:
                assert result.outcome == "failed"
                assert "has not answered for 2.5 s" in result.reason
                until(lambda: (said := near.status().engine) and said.link.up, 10, "the link does not come back")
                held(near, MARGIN_S)
                task_works(near, engine.folder)
    finally:
        line.close()


def test_a_client_connects_again_by_itself(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, short)
    with serving(service):
        line = Line(service.endpoint)
        try:
            with Client("bench", connect=(line.endpoint,), timeout_s=2.0) as client, client.watch() as stream:
                task = client.start(seed=1, detach=True)
                until(lambda: stream.receive(1.0), 10, "nothing is heard")
                line.cut()
                client.timeout_s = 0.3
                until(lambda: not answers(client), 5, "the line is not cut")
                line.mend()
                until(lambda: answers(client), 10, "the client does not come back")
                client.timeout_s = 2.0
                while stream.receive(0.0) is not None:
                    pass
                until(lambda: stream.receive(1.0), 10, "nothing is heard any more")
                assert client.wait(task, timeout_s=60).outcome in ENDS
        finally:
            line.close()


def test_stop_reaches_both_processes(short: Mapping[str, Any], tmp_path: Path) -> None:
    rig, engine = split(short, tmp_path)
    with both(rig, engine) as (client, _), rig.client("ben") as ben:
        task = client.start(seed=1)
        for refused in (ben.start, ben.home, lambda: ben.move(joints_deg=(1.0, 2.0))):
            with pytest.raises(RequestRefused, match=r"of tester|moved by bench-") as busy:
                refused()
            assert busy.value.code == "busy"
        under_way(client)
        assert ben.stop("smoke").roles == ("engine", "rig")
        say("stopped, rig holds after", held(client, MARGIN_S))
        result = client.wait(task, timeout_s=20)
        assert result.outcome == "failed"
        assert "stopped by ben: smoke" in result.reason
        complete(result, engine.folder)
        assert rig_of(client).faults == ()
        task_works(client, engine.folder)
