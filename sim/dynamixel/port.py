"""A pseudo-terminal with an emulated bus behind it: what a USB adapter's serial port is to real servos. Linux only."""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import os
import select
import struct
import threading
import time
import tty
from pathlib import Path
from types import TracebackType
from typing import Self

from viewsep.errors import RigError
from viewsep.sim.dynamixel.bus import EmulatedBus

_TCGETS2 = 0x802C542A  # the only way to learn a speed that has no constant
_TERMIOS2 = struct.Struct("4I20B2I")
IDLE_S = 0.02  # between two looks at what is due though no bytes come


class EmulatedPort:
    """Serves a bus at `name` from a thread until it is closed.

    `link` is a symbolic link to the terminal; it stays the same when the port is unplugged and plugged in again.
    `latency_s` is what the adapter adds to every reply. Raises RigError when `link` is there and is not a link.
    """

    def __init__(self, bus: EmulatedBus, link: Path | None = None, latency_s: float = 0.0) -> None:
        if link is not None and link.exists() and not link.is_symlink():
            raise RigError(f"{link} exists and is not a link: choose another name for the emulated port")
        self.bus = bus
        self._link = link
        self._latency_s = latency_s
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._terminal = ""
        self._pending: list[tuple[float, int, bytes]] = []  # when, order, what
        self._sent = 0
        self._closing = False
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="emulated servos", daemon=True)
        bus.unplug = self.unplug
        self.plug()
        self._thread.start()

    @property
    def name(self) -> str:
        """The path to open."""
        return str(self._link) if self._link is not None else self._terminal

    @property
    def plugged(self) -> bool:
        """Whether there is a terminal."""
        return self._master >= 0

    def plug(self) -> None:
        """Make a terminal, unless there is one."""
        with self._lock:
            if self._closing or self.plugged:
                return
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._terminal = os.ttyname(self._slave)
            if self._link is not None:
                self._link.unlink(missing_ok=True)
                self._link.symlink_to(self._terminal)
        self._wake()

    def unplug(self) -> None:
        """Take the terminal away: whoever has it open sees a hang-up. The servos stay powered."""
        with self._lock:
            if not self.plugged:
                return
            if self._link is not None:
                self._link.unlink(missing_ok=True)
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1
            self._pending.clear()
        self._wake()

    def close(self) -> None:
        """Unplug and end the thread."""
        self._closing = True
        self.unplug()
        self._wake()
        if threading.current_thread() is not self._thread:
            self._thread.join(5.0)
            for end in (self._wake_read, self._wake_write):
                with contextlib.suppress(OSError):
                    os.close(end)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._wake_write, b"\0")

    def _serve(self) -> None:
        while not self._closing:
            master = self._master
            due_s = self._pending[0][0] - time.monotonic() if self._pending else IDLE_S
            watched = [self._wake_read] if master < 0 else [self._wake_read, master]
            try:
                ready, _, _ = select.select(watched, [], [], max(0.0, min(due_s, IDLE_S)))
            except (OSError, ValueError):  # unplugged in between
                continue
            if self._wake_read in ready:
                os.read(self._wake_read, 4096)
            if master in ready:
                self._take()
            self._give()
            if not ready:
                self.bus.advance()

    def _take(self) -> None:
        with self._lock:
            if not self.plugged:
                return
            try:
                data, baud = os.read(self._master, 4096), _speed(self._slave)
            except OSError:
                return
        started_s = time.monotonic() + self._latency_s
        for reply in self.bus.receive(data, baud):
            self._sent += 1
            heapq.heappush(self._pending, (started_s + reply.delay_s, self._sent, reply.data))

    def _give(self) -> None:
        with self._lock:
            while self._pending and self._pending[0][0] <= time.monotonic():
                data = heapq.heappop(self._pending)[2]
                if self.plugged:
                    with contextlib.suppress(OSError):  # nobody reads: a full buffer loses bytes, as a line would
                        os.write(self._master, data)


def _speed(terminal: int) -> int:
    """Bits per second a terminal is set to."""
    settings = bytearray(_TERMIOS2.size)
    fcntl.ioctl(terminal, _TCGETS2, settings)
    return int(_TERMIOS2.unpack(settings)[-1])
