"""A rig served on Zenoh within the test's process, over a TCP connection that the test can cut."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh
from ports import free_port

from viewsep.built_rig import SimulatedRig
from viewsep.config import Config
from viewsep.rigs import simulated_rig
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.service.lease import Lease
from viewsep.service.names import Keys
from viewsep.service.remote import RemoteRig
from viewsep.service.rig_server import RigServer
from viewsep.service.served_rig import ServedRig

KEYS = Keys("test")


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def open_session(*, listen: str = "", connect: str = "") -> zenoh.Session:
    settings = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "scouting/delay": 0,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2},
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Station:
    """The rig's process: hardware, and a session with a server that can be closed and opened again."""

    def __init__(self, served: ServedRig) -> None:
        self.served = served
        self.endpoint = free_endpoint()
        self._online: tuple[zenoh.Session, RigServer] | None = None

    def go_online(self) -> None:
        session = open_session(listen=self.endpoint)
        server = RigServer(session, KEYS, self.served)
        server.open()
        self._online = session, server

    def go_offline(self) -> None:
        if self._online is not None:
            session, server = self._online
            self._online = None
            server.close()
            session.close()


def served_simulation(simulated: SimulatedRig, *, speed: float = 0.0, lease_s: float = 2.0) -> ServedRig:
    rig = simulated.rig
    return ServedRig(
        SharedMotion(rig.motion, Lease(lease_s)),
        SharedCamera(rig.camera, rig.clock, stepped=speed == 0.0),
        rig.geometry,
        rig.clock,
        simulated.config,
        speed=speed,
        simulated=True,
        holds="generated:7",
        pictures=simulated.pictures.value,
    )


@contextmanager
def station(
    config: Config | None = None, *, speed: float = 0.0, lease_s: float = 2.0, seed: int = 0
) -> Iterator[Station]:
    """A simulated rig with its devices open, online."""
    simulated = simulated_rig(config or Config(), "generated:7", seed, speed=speed)
    served = served_simulation(simulated, speed=speed, lease_s=lease_s)
    served.motion.connect()
    served.camera.connect()
    here = Station(served)
    try:
        here.go_online()
        yield here
    finally:
        here.go_offline()
        served.motion.close()
        served.camera.close()


@contextmanager
def remote_rig(here: Station, *, resume_s: float = 5.0) -> Iterator[RemoteRig]:
    """The rig as another process sees it."""
    session = open_session(connect=here.endpoint)
    try:
        with RemoteRig(session, KEYS, resume_s=resume_s) as remote:
            yield remote
    finally:
        session.close()


def wait_for(condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
    """Poll until it holds; an AssertionError after `timeout_s`."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "what was waited for did not happen"
        time.sleep(0.005)
