"""QEMU's monitor protocol: JSON lines on a unix socket."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Refused(Exception):
    """QEMU did not do what it was asked; the text is its reason."""


class Qmp:
    """A connection to QEMU's monitor.

    Waits up to `timeout_s` for the socket, while QEMU is `alive`; raises TimeoutError, Refused.
    """

    def __init__(self, path: Path, timeout_s: float, alive: Callable[[], bool]) -> None:
        self._socket = _connected(path, timeout_s, alive)
        self._file = self._socket.makefile("r")
        self._events: list[str] = []
        self._socket.settimeout(timeout_s)
        self._receive()  # the greeting
        self.ask("qmp_capabilities")

    def close(self) -> None:
        """Leave the monitor."""
        self._file.close()
        self._socket.close()

    def ask(self, command: str, **arguments: Any) -> None:
        """Send a command and wait for its answer. Raises Refused."""
        self._socket.sendall(json.dumps({"execute": command, "arguments": arguments}).encode() + b"\n")
        while True:
            answer = self._receive()
            if "error" in answer:
                raise Refused(f"{command} {arguments}: {answer['error']['desc']}")
            if "return" in answer:
                return

    def wait_for(self, event: str, timeout_s: float) -> None:
        """Wait for an event that came since the last wait. Raises TimeoutError."""
        self._socket.settimeout(timeout_s)
        while event not in self._events:
            self._receive()
        self._events.clear()

    def _receive(self) -> dict[str, Any]:
        line = self._file.readline()
        if not line:
            raise Refused("QEMU has closed its monitor")
        message: dict[str, Any] = json.loads(line)
        if "event" in message:
            self._events.append(message["event"])
        return message


def _connected(path: Path, timeout_s: float, alive: Callable[[], bool]) -> socket.socket:
    deadline = time.monotonic() + timeout_s
    while True:
        connection = socket.socket(socket.AF_UNIX)
        try:
            connection.connect(str(path))
            return connection
        except (FileNotFoundError, ConnectionRefusedError):
            connection.close()
            if not alive():
                raise Refused("QEMU ended at once") from None
            if time.monotonic() > deadline:
                raise TimeoutError(f"QEMU opened no monitor at {path} within {timeout_s:.0f} s") from None
            time.sleep(0.02)
