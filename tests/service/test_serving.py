"""One process serves the simulated rig: a task from start to result, requests, status, recordings, the end."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from processes import Serving, complete, engine_of, rig_of, serving, still, until

from viewsep.client import LogLine, RequestRefused
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify


@pytest.fixture
def service(settings: Mapping[str, Any], tmp_path: Path) -> Serving:
    return Serving(tmp_path, settings)


def command(service: Serving, *typed: str) -> subprocess.CompletedProcess[str]:
    """A `viewsep` command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "viewsep", typed[0], *typed[1:], "--connect", service.endpoint],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_start_and_watch_end_with_the_right_object_and_its_recording_replays(service: Serving) -> None:
    with serving(service):
        started = command(service, "start", "--seed", "1", "--pose-tolerance", "3.5")
        assert started.returncode == 0, started.stderr
        watched = command(service, "watch")
        assert watched.returncode == 0, watched.stdout + watched.stderr
        assert "product_7" in watched.stdout
        with service.client() as client:
            said = client.status().engine
            assert said is not None
            assert said.result is not None
    assert said.result.object == "product_7"
    assert complete(said.result, service.folder) == said.result.looks > 1
    (recording,) = (service.folder / "recordings").glob("*.mcap")
    assert json.loads(read_recording(recording).metadata["config"]["json"])["task"]["pose_tolerance_deg"] == 3.5


def test_one_task_at_a_time_and_only_its_owner_cancels_it(service: Serving) -> None:
    with serving(service), service.client("ana") as ana, service.client("ben") as ben:
        task = ana.start(seed=1)
        with pytest.raises(RequestRefused, match="of ana is running") as busy:
            ben.start()
        assert busy.value.code == "busy"
        with pytest.raises(RequestRefused, match="the rig is moved by") as held:
            ben.home()
        assert held.value.code == "busy"
        with pytest.raises(RequestRefused, match="belongs to ana") as foreign:
            ben.cancel()
        assert foreign.value.code == "not_owner"
        ana.cancel("lunch")
        result = ana.wait(task, timeout_s=20)
        assert (result.outcome, result.reason) == ("failed", "cancelled: lunch")
        with pytest.raises(RequestRefused, match="no task"):
            ana.cancel()


def test_anybody_may_stop_and_the_joints_hold(service: Serving) -> None:
    with serving(service), service.client("ana") as ana, service.client("ben") as ben:
        task = ana.start(seed=1)
        ben.stop("smoke")
        result = ana.wait(task, timeout_s=20)
        assert result.outcome == "failed"
        assert "stopped by ben: smoke" in result.reason
        first = until(lambda: still(ana.status()), 10, "the joints do not come to rest")
        assert still(ana.status()) == first
        assert rig_of(ana).motion.holder == ""


def test_an_owner_that_goes_away_leaves_a_rig_that_holds(service: Serving) -> None:
    with serving(service), service.client("ben") as ben:
        script = (
            "from viewsep.client import Client; import time\n"
            f"c = Client('bench', connect=('{service.endpoint}',), owner='ana').__enter__()\n"
            "print(c.start(seed=1), flush=True); time.sleep(60)\n"
        )
        owner = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
        assert owner.stdout is not None
        task = owner.stdout.readline().strip()
        assert task
        owner.kill()
        owner.wait()
        owner.stdout.close()
        result = ben.wait(task, timeout_s=20)
        assert (result.outcome, result.reason) == ("failed", "cancelled: its owner, ana, has gone")
        until(lambda: still(ben.status()), 10, "the joints do not come to rest")


def test_moves_arrive_and_what_cannot_be_reached_is_refused(service: Serving) -> None:
    with serving(service), service.client() as client:
        client.move(joints_deg=(20.0, 40.0))
        until(lambda: still(client.status()) and rig_of(client).motion.holder == "", 20, "no rest")
        assert still(client.status()) == pytest.approx((20.0, 40.0), abs=0.5)
        client.home()
        until(lambda: still(client.status()) and rig_of(client).motion.holder == "", 20, "no rest")
        assert still(client.status()) == pytest.approx((0.0, 0.0), abs=0.5)
        with pytest.raises(RequestRefused, match="set-points were given") as refusal:
            client.move(joints_deg=(1.0, 2.0, 3.0))
        assert refusal.value.code == "unreachable"


def test_moves_one_right_after_the_other_all_arrive(settings: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, {**settings, "service": {**settings["service"], "speed": 1.0}})
    with serving(service), service.client() as client:
        for number in range(16):  # the next is asked for before the rig has noticed that the last one has arrived
            angle = 3.0 * (number % 2)
            client.settle(client.move(joints_deg=(angle, angle)), timeout_s=20)
            assert still(client.status()) == pytest.approx((angle, angle), abs=0.5)
        for angle in (30.0, -20.0, 10.0):  # each takes the place of the one before
            goal = client.move(joints_deg=(angle, angle))
        client.settle(goal, timeout_s=20)
        assert still(client.status()) == pytest.approx((10.0, 10.0), abs=0.5)
        until(lambda: rig_of(client).motion.holder == "", 10, "the lease is not given back")


def test_models_are_learned_while_the_service_runs(settings: Mapping[str, Any], tmp_path: Path) -> None:
    own = {"service": {**settings["service"], "library": str(tmp_path / "new")}}
    service = Serving(tmp_path, own)
    with serving(service), service.client() as client:
        with pytest.raises(RequestRefused, match="learn the look-alikes") as refusal:
            client.start()
        assert refusal.value.code == "no_models"
        client.learn("generated:3", views=12)
        until(lambda: engine_of(client).models and not engine_of(client).learning, 60, "nothing was learned")
        assert list(engine_of(client).models) == ["product_3"]
        client.learn("nowhere/at/all")
        fault = until(lambda: engine_of(client).faults, 60, "no fault")
        assert "nowhere/at/all was not learned" in fault[0]


def test_the_log_is_published_once_by_the_role_it_is_of(service: Serving) -> None:
    with serving(service), service.client("ana") as ana, ana.watch(("log",)) as stream:
        task = ana.start(seed=1)
        ana.stop("smoke")
        ana.wait(task, timeout_s=20)
        lines = []
        while (received := stream.receive(1.0)) is not None:
            assert isinstance(received.message, LogLine)
            lines.append((received.message.name, received.message.message))
    assert len(lines) == len(set(lines))
    assert ("rig", "stopped by ana: smoke") in lines
    assert any(name == "engine" and text.startswith(f"task {task} started by ana") for name, text in lines)


def test_recording_can_be_switched_off(service: Serving) -> None:
    with serving(service), service.client() as client:
        client.record(False)
        result = client.wait(client.start(seed=1), timeout_s=60)
        assert result.recording is None
        assert not list((service.folder / "recordings").glob("*"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("running", [False, True])
def test_the_end_is_in_good_order(service: Serving, number: int, running: bool) -> None:
    with serving(service):
        if running:
            with service.client() as client:
                client.start(seed=1, detach=True)
                until(lambda: engine_of(client).looks > 2, 20, "no looks")
        assert service.end(number) == 0
    files = [path.name for path in (service.folder / "recordings").glob("*")]
    assert len(files) == int(running)
    assert all(name.endswith(".mcap") for name in files)
    if running:
        verify(read_recording(next((service.folder / "recordings").glob("*.mcap"))))
    assert "Traceback" not in service.log
    again = Serving(service.folder, service.settings, port=service.port, image_port=service.image_port)
    with serving(again):  # the ports are free
        pass


def test_a_port_in_use_is_one_sentence(service: Serving) -> None:
    with serving(service):
        config = str(service.folder / f"serve-{service.port}.toml")
        typed = [sys.executable, "-m", "viewsep", "serve", "--config", config]
        ended = subprocess.run(typed, capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == 2
    assert service.endpoint in ended.stderr
    assert "Traceback" not in ended.stderr


def test_threads_and_files_do_not_pile_up(service: Serving) -> None:
    with serving(service), service.client() as client:
        assert service.process is not None
        used = []
        for _ in range(3):
            client.wait(client.start(seed=1), timeout_s=60)
            proc = Path("/proc") / str(service.process.pid)
            used.append((len(list((proc / "task").iterdir())), len(list((proc / "fd").iterdir()))))
    assert max(used) <= (used[0][0] + 1, used[0][1] + 1), json.dumps(used)
