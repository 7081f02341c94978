"""A device node and the kernel's ioctls on it: what it is, what it can, what its controls are set to.

The structures are those of linux/videodev2.h on a 64-bit machine.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from viewsep.drivers.v4l2.errors import CameraLost
from viewsep.drivers.v4l2.system import THIS_MACHINE, System

VIDEO_CAPTURE, STREAMING, DEVICE_CAPS = 0x1, 0x0400_0000, 0x8000_0000  # of struct v4l2_capability
CAPTURE = 1  # enum v4l2_buf_type
MMAP = 1  # enum v4l2_memory
DISCRETE = 1  # enum v4l2_frmsizetypes, v4l2_frmivaltypes
DISABLED, READ_ONLY, INACTIVE = 0x1, 0x4, 0x10  # flags of a control
NEXT_CONTROL = 0x8000_0000
MOST = 256  # of anything that is listed: a driver that never ends is not followed for ever


@dataclass(frozen=True, slots=True)
class Structure:
    """A request of the kernel and the layout of what goes with it."""

    request: int
    layout: struct.Struct

    @classmethod
    def of(cls, number: int, layout: str, size: int, direction: int = 3) -> Structure:
        """With `_IOR` (direction 2) or `_IOWR` (3) of class 'V'; the layout is padded to its size."""
        fields = struct.Struct("=" + layout)
        padded = struct.Struct(f"={layout}{size - fields.size}x")
        return cls(direction << 30 | size << 16 | ord("V") << 8 | number, padded)


QUERYCAP = Structure.of(0, "16s32s32sIII", 104, direction=2)
ENUM_FMT = Structure.of(2, "III32sI", 64)  # index, type, flags, description, format
G_FMT = Structure.of(4, "I4xIIIIII", 208)  # type, width, height, format, field, bytes per line, size
REQBUFS = Structure.of(8, "III", 20)  # count, type, memory
G_PARM = Structure.of(21, "IIIII", 204)  # type, capability, mode, numerator, denominator
G_CTRL = Structure.of(27, "Ii", 8)
S_CTRL = Structure.of(28, "Ii", 8)
QUERYCTRL = Structure.of(36, "II32siiiiI", 68)  # id, type, name, minimum, maximum, step, default, flags
ENUM_FRAMESIZES = Structure.of(74, "III6I", 44)  # index, format, type, sizes
ENUM_FRAMEINTERVALS = Structure.of(75, "IIIII6I", 52)  # index, format, width, height, type, intervals


@dataclass(frozen=True, slots=True)
class Capability:
    """What a node is."""

    driver: str
    card: str
    bus: str
    flags: int

    @property
    def captures(self) -> bool:
        """Whether it gives pictures; other nodes of a camera give descriptions of them, or take pictures."""
        return bool(self.flags & VIDEO_CAPTURE and self.flags & STREAMING)


@dataclass(frozen=True, slots=True)
class Mode:
    """A size of pictures in a format, and the rates it is delivered at, fastest first; empty where any will do."""

    format: str
    width: int
    height: int
    rates_hz: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Control:
    """A control as the driver describes it."""

    id: int
    name: str
    minimum: int
    maximum: int
    step: int
    default: int
    flags: int

    @property
    def usable(self) -> bool:
        """Whether it can be set at all."""
        return not self.flags & (DISABLED | READ_ONLY)


class Node:
    """An open device node; several may be open at once. Raises CameraLost with the reason and a remedy."""

    def __init__(self, path: str | Path, system: System = THIS_MACHINE) -> None:
        self.path = str(path)
        self._system = system
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise CameraLost(why_not(self.path, error)) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)

    def capability(self) -> Capability:
        """What it is. Raises CameraLost where it is no video device."""
        try:
            driver, card, bus, _, flags, device_flags = self._ask(QUERYCAP)
        except OSError as error:
            raise CameraLost(
                f"{self.path} is no camera ({error.strerror}): `viewsep camera list` lists them"
            ) from error
        return Capability(_text(driver), _text(card), _text(bus), device_flags if flags & DEVICE_CAPS else flags)

    def formats(self) -> tuple[str, ...]:
        """Names of four letters, as `YUYV`."""
        return tuple(struct.pack("=I", entry[4]).decode("latin-1") for entry in self._listed(ENUM_FMT, CAPTURE))

    def modes(self) -> tuple[Mode, ...]:
        """Sizes and rates of every format; of ranges the smallest and the largest."""
        return tuple(
            Mode(format, width, height, self._rates_hz(format, width, height))
            for format in self.formats()
            for width, height in self._sizes(format)
        )

    def bytes_per_line(self) -> int:
        """Of the pictures as they are set. Raises OSError."""
        line: int = self._ask(G_FMT, CAPTURE)[5]
        return line

    def rate_hz(self) -> float:
        """As it is set; 0 where the driver knows none."""
        with suppress(OSError):
            _, _, _, numerator, denominator = self._ask(G_PARM, CAPTURE)
            return denominator / numerator if numerator else 0.0
        return 0.0

    def is_busy(self) -> bool:
        """Whether somebody else gets its pictures at the moment. Harmless: asks for no buffers."""
        try:
            self._ask(REQBUFS, 0, CAPTURE, MMAP)
        except OSError as error:
            return error.errno == errno.EBUSY
        return False

    def controls(self) -> tuple[Control, ...]:
        """All that can be set to a number."""
        found: list[Control] = []
        last = 0
        while len(found) < MOST:
            try:
                control = self._control(last | NEXT_CONTROL)
            except OSError:
                break
            if control.id <= last:
                break
            last = control.id
            found.append(control)
        return tuple(found)

    def control(self, number: int) -> Control | None:
        """One of them; None where the camera does not have it."""
        try:
            found = self._control(number)
        except OSError:
            return None
        return None if found.flags & DISABLED else found

    def value(self, number: int) -> int:
        """What a control is set to. Raises OSError."""
        value: int = self._ask(G_CTRL, number, 0)[1]
        return value

    def set_value(self, number: int, value: int) -> None:
        """Set a control; the driver may take another value without a word. Raises OSError."""
        self._ask(S_CTRL, number, value)

    def _control(self, number: int) -> Control:
        found, _, name, minimum, maximum, step, default, flags = self._ask(QUERYCTRL, number)
        return Control(found, _text(name), minimum, maximum, step, default, flags)

    def _sizes(self, format: str) -> list[tuple[int, int]]:
        sizes: list[tuple[int, int]] = []
        for _, _, kind, *numbers in self._listed(ENUM_FRAMESIZES, _code(format)):
            if kind != DISCRETE:  # a range: minimum, maximum, step of the width, then of the height
                return [(numbers[0], numbers[3]), (numbers[1], numbers[4])]
            sizes.append((numbers[0], numbers[1]))
        return sizes

    def _rates_hz(self, format: str, width: int, height: int) -> tuple[float, ...]:
        rates: list[float] = []
        for _, _, _, _, kind, *numbers in self._listed(ENUM_FRAMEINTERVALS, _code(format), width, height):
            shortest_and_longest = (numbers[:2], numbers[2:4]) if kind != DISCRETE else (numbers[:2],)
            rates += [below / above for above, below in shortest_and_longest if above]
            if kind != DISCRETE:
                break
        return tuple(sorted(rates, reverse=True))

    def _listed(self, structure: Structure, *given: int) -> Iterator[tuple[int, ...]]:
        """Entries 0, 1, 2, ... until the driver knows no more."""
        for index in range(MOST):
            try:
                yield self._ask(structure, index, *given)
            except OSError:
                return

    def _ask(self, structure: Structure, *given: int) -> tuple[int, ...]:
        """Send a request with its first fields given and the others 0; what comes back. Raises OSError."""
        data = bytearray(structure.layout.size)
        struct.pack_into(f"={len(given)}I", data, 0, *(number & 0xFFFF_FFFF for number in given))
        self._system.ioctl(self._file, structure.request, data)
        return structure.layout.unpack(data)


def why_not(path: str, error: OSError) -> str:
    """A sentence that says why a node cannot be opened, and the remedy."""
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return f"there is no camera {path}: plug it in; `viewsep camera list` lists those there are"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"this user may not use the camera {path}: `sudo usermod -aG video $USER`, then log in anew"
    return f"the camera {path} cannot be opened: {error.strerror}"


def _code(format: str) -> int:
    return int.from_bytes(format.encode("latin-1"), "little")


def _text(field: object) -> str:
    assert isinstance(field, bytes)
    return field.split(b"\0")[0].decode("utf-8", "replace")
