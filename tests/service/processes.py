"""Real serving processes on 127.0.0.1, each ended by its own id."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from ports import free_port

from viewsep.client import Client, NoAnswer
from viewsep.messages import Estimate, PerceptReceived
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.service.status import EngineStatus, ResultStatus, RigStatus, Status

STARTS_S = 30.0
T = TypeVar("T")


def until(what: Callable[[], T], timeout_s: float, says: str) -> T:
    """The first true value of `what`; fails when none comes in time."""
    deadline = time.monotonic() + timeout_s
    while True:
        value = what()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError(f"{says}: not within {timeout_s:g} s, last seen {value!r}")
        time.sleep(0.02)


@dataclass
class Serving:
    """One `viewsep serve` or `router` process. `port` carries everything but pictures, which are on `image_port`.

    With `service.keys` in the settings it listens by TLS.
    """

    folder: Path
    settings: Mapping[str, Any]
    arguments: tuple[str, ...] = ()
    command: str = "serve"
    port: int = field(default_factory=free_port)
    image_port: int = field(default_factory=free_port)
    environment: Mapping[str, str] = field(default_factory=dict)
    process: subprocess.Popen[bytes] | None = None
    _said_before: int = 0

    @property
    def endpoint(self) -> str:
        return f"{self._protocol}/127.0.0.1:{self.port}"

    @property
    def image_endpoint(self) -> str:
        return f"{self._protocol}/127.0.0.1:{self.image_port}"

    @property
    def keys(self) -> str:
        """Its folder of certificates, empty without."""
        return str(self.settings.get("service", {}).get("keys", ""))

    @property
    def _protocol(self) -> str:
        return "tls" if self.keys else "tcp"

    @property
    def log(self) -> str:
        """What it has said so far."""
        return self._log_file.read_text(encoding="utf-8", errors="replace")

    @property
    def _log_file(self) -> Path:
        return self.folder / f"serve-{self.port}.log"

    def start(self) -> Serving:
        """Start the process and wait until it says that it serves."""
        self.launch()
        self.wait_until_served()
        return self

    def launch(self) -> None:
        """Start the process."""
        self.folder.mkdir(parents=True, exist_ok=True)
        config = self.folder / f"serve-{self.port}.toml"
        config.write_text(self._toml(), encoding="utf-8")
        command = [sys.executable, "-m", "viewsep", self.command, "--config", str(config), *self.arguments]
        with self._log_file.open("ab") as log:
            self._said_before = self._log_file.stat().st_size
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=self.folder,
                start_new_session=True,
                env={**os.environ, "PYTHONFAULTHANDLER": "1", **self.environment},
            )

    def wait_until_served(self) -> None:
        """Wait until it says that it serves."""
        says = "the service does not start"
        words = ("serving ", "routing ")
        until(lambda: any(word in self.log[self._said_before :] for word in words) or self._gone(), STARTS_S, says)
        assert not self._gone(), self.log

    def send(self, number: int) -> None:
        """Send a signal to the process."""
        assert self.process is not None
        os.kill(self.process.pid, number)

    def end(self, number: int = signal.SIGTERM, timeout_s: float = 30.0) -> int:
        """End the process and return its exit code; it is killed when it does not end in time."""
        assert self.process is not None
        self.send(number)
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.send(signal.SIGABRT)  # writes where its threads are to the log
            self.process.wait()
            raise AssertionError(f"the service did not end within {timeout_s:g} s:\n{self.log}") from None

    def client(self, owner: str = "tester", **options: Any) -> Client:
        """A client of it."""
        return Client(self.settings["service"]["name"], connect=(self.endpoint,), owner=owner, **options)

    def _gone(self) -> bool:
        assert self.process is not None
        return self.process.poll() is not None

    def _toml(self) -> str:
        service = {
            "listen": [self.endpoint],
            "listen_images": [self.image_endpoint],
            **self.settings.get("service", {}),
        }
        return tomlkit.dumps({**self.settings, "service": service})


@contextmanager
def serving(*services: Serving) -> Iterator[None]:
    """Start them at the same time; afterwards those that still run are ended."""
    try:
        for service in services:
            service.launch()
        for service in services:
            service.wait_until_served()
        yield
    finally:
        for service in reversed(services):
            if service.process is not None and service.process.poll() is None:
                service.send(signal.SIGCONT)
                service.end()


@contextmanager
def running(script: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A Python script in a process of its own that is killed at the end, also when it stands still."""
    typed = [sys.executable, "-c", script, *arguments]
    with subprocess.Popen(typed, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def split(settings: Mapping[str, Any], folder: Path, connect: str = "", **service: Any) -> tuple[Serving, Serving]:
    """The two processes of one rig; the engine's connects to the rig's endpoint, or to another one."""
    common = {**settings, "service": {**settings["service"], **service}}
    rig = Serving(folder / "rig", common, ("--role", "rig"))
    connected = {**common, "service": {**common["service"], "connect": [connect or rig.endpoint]}}
    return rig, Serving(folder / "engine", connected, ("--role", "engine"))


def engine_of(client: Client) -> EngineStatus:
    """The engine's section of the status."""
    said = client.status().engine
    assert said is not None
    return said


def rig_of(client: Client) -> RigStatus:
    """The rig's section of the status."""
    said = client.status().rig
    assert said is not None
    return said


def still(status: Status) -> tuple[float, ...]:
    """Joint angles of a rig at rest, empty when it moves."""
    assert status.rig is not None
    motion = status.rig.motion
    return () if motion.moving else tuple(joint.position_deg for joint in motion.joints)


def under_way(client: Client, looks: int = 5) -> str:
    """Wait until a task has taken some looks and the joints move; its name."""
    return until(
        lambda: said.task if (said := engine_of(client)).looks >= looks and rig_of(client).motion.moving else "",
        30,
        "no task is under way",
    )


def held(client: Client, within_s: float) -> float:
    """Wait until nobody holds the rig and it stands, and see that it goes on standing; seconds until then."""
    begun = time.monotonic()

    def rest() -> tuple[float, ...]:
        status = client.status()
        return still(status) if status.rig is not None and status.rig.motion.holder == "" else ()

    at = until(rest, within_s, "the rig does not hold")
    took_s = time.monotonic() - begun
    for _ in range(10):
        assert still(client.status()) == at
        time.sleep(0.03)
    return took_s


def complete(result: ResultStatus, folder: Path) -> int:
    """Check that a task's recording under `folder` replays and has every percept once; the number of looks in it."""
    assert result.recording is not None
    assert not list((folder / result.recording).parent.glob("*.part"))
    content = read_recording(folder / result.recording)
    verify(content)
    percepts = [r.message.percept.sequence for r in content.messages if isinstance(r.message, PerceptReceived)]
    assert percepts == sorted(set(percepts))
    return len({r.message.iteration for r in content.messages if isinstance(r.message, Estimate)})


def answers(client: Client) -> bool:
    """Whether the status is answered."""
    try:
        client.status()
    except NoAnswer:
        return False
    return True
