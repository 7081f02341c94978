"""The serial port as dynamixel-sdk's packet handler wants it, without the traps of the SDK's own `PortHandler`.

Times are those of the monotonic clock; waiting sleeps instead of spinning; one process at a time; every error of the
line is PortLost, also the `termios.error` that an unplugged adapter raises.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import serial

from viewsep.drivers.dynamixel.errors import PortLost

BITS_PER_BYTE = 10  # start, eight, stop
USB_LATENCY_S = 0.016  # how long an FTDI adapter keeps bytes back unless it is told otherwise
SCHEDULING_S = 0.010  # what the machine may add
WRITE_TIMEOUT_S = 0.5

Trace = Callable[[str, bytes], None]
"""Hears of every packet: `>` and what was sent, `<` and what came back."""


class SerialPort:
    """An exclusive serial port. The names in mixedCase are the SDK's; its packet handlers call them."""

    def __init__(self, name: str, baud: int, trace: Trace | None = None) -> None:
        self.name = name
        self.baud = baud
        self.is_using = False  # the SDK's own guard; `Bus` has a lock and resets it
        self._trace = trace
        self._serial: serial.Serial | None = None
        self._deadline_s = 0.0
        self._latency_s = USB_LATENCY_S
        self._received = b""

    @property
    def is_open(self) -> bool:
        """Whether the port is held."""
        return self._serial is not None

    @property
    def latency_s(self) -> float:
        """How long the adapter may keep bytes back: what Linux says of it, otherwise `USB_LATENCY_S`."""
        return self._latency_s

    def open(self) -> None:
        """Take the port for this process alone. Raises PortLost and says who has it."""
        if self._serial is not None:
            return
        try:
            opened = serial.Serial(self.name, self.baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            raise PortLost(_why_not(self.name, error)) from error
        with suppress(OSError):  # programs that do not ask for the lock find the port busy
            fcntl.ioctl(opened.fileno(), termios.TIOCEXCL)
        self._serial = opened
        self.is_using = False
        self._latency_s = usb_latency_s(self.name) or USB_LATENCY_S

    def close(self) -> None:
        """Give the port back. Safe to call twice."""
        held, self._serial = self._serial, None
        if held is not None:
            with suppress(OSError, termios.error):
                fcntl.ioctl(held.fileno(), termios.TIOCNXCL)
            with suppress(OSError, termios.error):
                held.close()

    def wire_time_s(self, count: int) -> float:
        """How long `count` bytes are on the line."""
        return count * BITS_PER_BYTE / self.baud

    def drain(self, quiet_s: float, longest_s: float) -> int:
        """Throw away what still comes until the line was quiet for `quiet_s`; returns the number of bytes."""
        until_s = time.monotonic() + longest_s
        thrown = 0
        with self._line() as line:
            while (left_s := until_s - time.monotonic()) > 0 and _readable(line, min(quiet_s, left_s)):
                thrown += len(line.read(4096))
        return thrown

    def wait_at_most(self, seconds: float) -> None:
        """Set the deadline of the reply that is read next."""
        self._received = b""
        self._deadline_s = time.monotonic() + seconds

    def take_received(self) -> bytes:
        """The bytes read since the deadline was set, for the trace."""
        received, self._received = self._received, b""
        return received

    # what the SDK's packet handler calls

    def clearPort(self) -> None:  # noqa: N802
        """Throw away what has come unasked."""
        with self._line() as line:
            line.reset_input_buffer()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Send bytes; returns how many."""
        data = bytes(packet)
        with self._line() as line:
            written = line.write(data) or 0
        if self._trace is not None:
            self._trace(">", data)
        return written

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """At most `length` bytes as soon as there are any; empty when the deadline passes."""
        left_s = self._deadline_s - time.monotonic()
        if length <= 0 or left_s <= 0:
            return b""
        with self._line() as line:
            data = line.read(length) if _readable(line, left_s) else b""
        self._received += data
        return data

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        """Set the deadline of a reply of `length` bytes, as the SDK asks for it."""
        self.wait_at_most(self.wire_time_s(length) + 2 * self._latency_s + SCHEDULING_S)

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the deadline has passed."""
        return time.monotonic() >= self._deadline_s

    @contextmanager
    def _line(self) -> Iterator[serial.Serial]:
        """The open port; whatever goes wrong with it is PortLost."""
        if self._serial is None:
            raise PortLost(f"the serial port {self.name} is not open: connect first")
        try:
            yield self._serial
        except serial.SerialTimeoutException as error:
            raise PortLost(f"the serial port {self.name} takes no bytes: check the adapter and its driver") from error
        except (OSError, termios.error, TypeError) as error:  # pyserial: TypeError when closed by another thread
            raise PortLost(f"the serial port {self.name} is gone: plug the adapter in again") from error


def usb_latency_s(name: str) -> float | None:
    """The latency timer of a USB adapter in seconds, None where Linux knows of none."""
    try:
        return int(latency_file(name).read_text(encoding="ascii")) * 1e-3
    except (OSError, ValueError):
        return None


def latency_file(name: str) -> Path:
    """Where Linux keeps the latency timer of a USB adapter."""
    return Path("/sys/bus/usb-serial/devices") / Path(name).resolve().name / "latency_timer"


def _readable(line: serial.Serial, seconds: float) -> bool:
    return bool(select.select([line.fileno()], [], [], seconds)[0])


def _why_not(name: str, error: BaseException) -> str:
    """A sentence that says why a port cannot be opened, and the remedy."""
    if not Path(name).exists():
        return f"there is no serial port {name}: check the cable, and `viewsep rig ports` for those there are"
    if not os.access(name, os.R_OK | os.W_OK):
        return f"this user may not use {name}: add it to the port's group, e.g. `sudo usermod -aG dialout $USER`"
    if not _is_serial(name):
        return f"{name} is no serial port: `viewsep rig ports` lists them"
    holder = _holder(Path(name))
    if holder:
        return f"the serial port {name} is used by process {holder}: end it, or use another port"
    return f"the serial port {name} cannot be opened: {error}"


def _is_serial(name: str) -> bool:
    """Whether it is a terminal, as serial ports are; one that another process keeps to itself is taken for one."""
    try:
        opened = os.open(name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        return error.errno == errno.EBUSY
    try:
        return os.isatty(opened)
    finally:
        os.close(opened)


def _holder(path: Path) -> str:
    """The process that has locked a file, as `1234 (viewsep)`; empty where it is not to be seen."""
    with suppress(OSError, IndexError, ValueError):
        status = path.stat()
        file = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            fields = line.split()
            if fields[1] == "FLOCK" and fields[5] == file and int(fields[4]) > 0:
                name = Path(f"/proc/{fields[4]}/comm").read_text(encoding="utf-8").strip()
                return f"{fields[4]} ({name})"
    return ""
