"""What goes wrong within a serving process: a disk without room, a plug-in and a driver with a bug."""

from __future__ import annotations

import os
import resource
import signal
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from processes import Serving, complete, engine_of, held, rig_of, serving, under_way, until

from viewsep.client import Client
from viewsep.config import parse_config
from viewsep.errors import ViewsepError
from viewsep.interfaces import MotionBackend
from viewsep.messages import JointState
from viewsep.rigs import rig_holding
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.service.lease import Lease
from viewsep.service.serve import Service
from viewsep.service.served_rig import ServedRig

ENDS = ("identified", "undecided")
PLUG_IN = '''
"""A planner with a bug: it fails at the fifth view."""
from viewsep.planning.random_motion import RandomOptions, RandomPlanner


class Planner(RandomPlanner):
    options_type = RandomOptions

    def next_view(self, state, view_direction, belief):
        state, view = super().next_view(state, view_direction, belief)
        if state.drawn + len(state.way) > 3 and belief is not None:
            raise ZeroDivisionError("the planner has a bug")
        return state, view
'''


class BuggyDriver:
    """A motion whose read-backs raise, from some moment on, what no driver should raise."""

    def __init__(self, motion: MotionBackend) -> None:
        self.broken = threading.Event()
        self._motion = motion

    def __getattr__(self, name: str) -> Any:
        return getattr(self._motion, name)

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        if self.broken.is_set():
            raise KeyError("a register that is not there")
        return self._motion.history(since_ns)


@pytest.fixture
def short(seed_settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tasks of a few seconds."""
    return {**seed_settings, "camera": {"rate_hz": 8.0, "size_px": 64}, "task": {"max_looks": 40}}


def room(service: Serving, file_bytes: int) -> None:
    """No file of the process may grow beyond that, as on a disk that is full; Python ignores SIGXFSZ."""
    assert service.process is not None
    resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (file_bytes, resource.RLIM_INFINITY))


def test_a_full_disk_fails_the_task_and_the_next_one_works(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, {**short, "task": {**short["task"], "max_looks": 400}})
    with serving(service), service.client() as client:
        task = client.start(seed=1)
        under_way(client)
        part = next((tmp_path / "recordings").glob("*.part"))
        room(service, part.stat().st_size)
        result = client.wait(task, timeout_s=60)
        assert result.outcome == "failed"
        assert "cannot be written" in result.reason
        assert result.recording is None
        held(client, 2.0)
        said = engine_of(client)
        assert said.recording.lost > 0
        assert not said.recording.open
        assert any("messages are missing" in fault and "cannot be written" in fault for fault in said.faults), said
        room(service, 100)  # not even the models fit
        refused = client.wait(client.start(seed=1), timeout_s=60)
        assert refused.outcome == "failed"
        assert "cannot be written" in refused.reason
        room(service, resource.RLIM_INFINITY)
        part.unlink()
        client.start(seed=3)
        again = under_way(client)
        client.cancel("enough")
        assert client.wait(again, timeout_s=60).reason == "cancelled: enough"
        assert engine_of(client).faults == ()
        assert engine_of(client).recording.lost == 0
        complete(client.wait(again), service.folder)
    assert "Traceback" not in service.log


def test_a_disk_that_is_full_at_the_end_costs_the_recording(short: Mapping[str, Any], tmp_path: Path) -> None:
    # nothing is written before the end: no time has come, and no chunk is full
    few = {"recording": {"sync_s": 60.0, "keyframe_s": 0.0}, "task": {**short["task"], "max_looks": 12}}
    service = Serving(tmp_path, {**short, **few})
    with serving(service), service.client() as client:
        task = client.start(seed=1)
        under_way(client)
        room(service, next((tmp_path / "recordings").glob("*.part")).stat().st_size)
        result = client.wait(task, timeout_s=60)
        assert result.outcome in ENDS, result.reason  # known before the last chunk was written
        assert result.recording is None
        held(client, 2.0)
        assert any("cannot be written" in fault for fault in engine_of(client).faults)
        room(service, resource.RLIM_INFINITY)
        assert client.wait(client.start(seed=3), timeout_s=60).outcome in ENDS
        assert engine_of(client).faults == ()
    assert "Traceback" not in service.log


def test_a_plug_in_with_a_bug_fails_the_task_and_not_the_service(short: Mapping[str, Any], tmp_path: Path) -> None:
    packages = tmp_path / "packages"
    info = packages / "buggy-1.0.dist-info"
    info.mkdir(parents=True)
    (packages / "buggy.py").write_text(PLUG_IN)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: buggy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[viewsep.planners]\nbuggy = buggy:Planner\n")
    buggy = {**short, "planner": {"name": "buggy"}}
    service = Serving(tmp_path, buggy, environment={"PYTHONPATH": str(packages)})
    with serving(service), service.client() as client:
        for _ in range(2):  # the service goes on
            result = client.wait(client.start(seed=1), timeout_s=60)
            assert result.outcome == "failed"
            assert "the planner has a bug" in result.reason
            assert any("the planner has a bug" in fault for fault in engine_of(client).faults)
            assert engine_of(client).recording.lost == 0
            held(client, 2.0)
        client.home()
        until(lambda: not rig_of(client).motion.moving and rig_of(client).motion.holder == "", 20, "no rest")
        assert service.end() == 0
    assert len(list((tmp_path / "recordings").glob("*.mcap"))) == 2
    assert not list((tmp_path / "recordings").glob("*.part"))


def test_a_driver_with_a_bug_ends_the_service_in_good_order(short: Mapping[str, Any], tmp_path: Path) -> None:
    ports = free_port(), free_port()
    endpoint, images = (f"tcp/127.0.0.1:{port}" for port in ports)
    own = {**short["service"], "listen": [endpoint], "listen_images": [images]}
    config = parse_config({**short, "service": own}, "the test")
    simulated = rig_holding("generated:7", [], config, 0, speed=config.service.speed)
    driver = BuggyDriver(simulated.rig.motion)
    served = ServedRig(
        motion=SharedMotion(driver, Lease(2.0)),
        camera=SharedCamera(simulated.rig.camera, simulated.rig.clock, stepped=False),
        geometry=simulated.rig.geometry,
        clock=simulated.rig.clock,
        config=config,
        speed=config.service.speed,
    )
    watchdog = threading.Timer(60, lambda: os.abort())
    watchdog.start()
    with pytest.raises(ViewsepError, match="ended by a bug, KeyError: 'a register") as ended:  # noqa: SIM117, PT012
        with Service(config, served, engine=True) as service:
            with Client("bench", connect=(endpoint,)) as client:
                client.start(seed=1, detach=True)
                under_way(client)
            driver.broken.set()
            service.ending.wait()
    watchdog.cancel()
    watchdog.join()
    assert ended.value.exit_code == 1
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("viewsep")] == []
    assert simulated.rig.motion.fault() == ""
    for port in ports:
        with socket.create_server(("127.0.0.1", port)):
            pass
    assert len(list((tmp_path / "recordings").glob("*.mcap"))) == 1
    assert not list((tmp_path / "recordings").glob("*.part"))


def test_a_signal_that_another_thread_gets_ends_the_service(short: Mapping[str, Any], tmp_path: Path) -> None:
    service = Serving(tmp_path, short)
    with serving(service):
        for _ in range(20):
            service.send(signal.SIGCONT)  # while one is pending, the kernel gives the next to another thread
        assert service.end() == 0
