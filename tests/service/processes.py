"""Real serving processes on 127.0.0.1, each ended by its own id."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from viewsep.client import Client, NoAnswer

STARTS_S = 30.0
T = TypeVar("T")


def free_port() -> int:
    """A port nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


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
    process: subprocess.Popen[bytes] | None = None

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
        self.folder.mkdir(parents=True, exist_ok=True)
        config = self.folder / f"serve-{self.port}.toml"
        config.write_text(self._toml(), encoding="utf-8")
        command = [sys.executable, "-m", "viewsep", self.command, "--config", str(config), *self.arguments]
        with self._log_file.open("ab") as log:
            before = self._log_file.stat().st_size
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=self.folder, start_new_session=True
            )
        until(
            lambda: any(word in self.log[before:] for word in ("serving ", "routing ")) or self._gone(),
            STARTS_S,
            "the service does not start",
        )
        assert not self._gone(), self.log
        return self

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
            self.process.kill()
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
        tables = {**self.settings, "service": service}
        return "\n".join(
            f"[{name}]\n" + "\n".join(f"{key} = {json.dumps(value)}" for key, value in table.items())
            for name, table in tables.items()
        )


@contextmanager
def serving(*services: Serving) -> Iterator[None]:
    """Start them in order; afterwards those that still run are ended."""
    try:
        for service in services:
            service.start()
        yield
    finally:
        for service in reversed(services):
            if service.process is not None and service.process.poll() is None:
                service.send(signal.SIGCONT)
                service.end()


def answers(client: Client) -> bool:
    """Whether the status is answered."""
    try:
        client.status()
    except NoAnswer:
        return False
    return True
