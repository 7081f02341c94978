"""In the machine: what Linux' own driver makes of a USB serial adapter, seen with pyserial."""

from __future__ import annotations

import errno
import fcntl
import os
import termios
from pathlib import Path

import serial
from steps import expect, say, step, wait_until

PLUG_S = 20.0
REPLY_S = 2.0
BY_ID = Path("/dev/serial/by-id/usb-QEMU_USB_SERIAL-if00-port0")
PING = bytes.fromhex("ff ff fd 00 01 03 00 01 19 4e")  # the manual's example: servo 1
STATUS_BEGINS = bytes.fromhex("ff ff fd 00 01 07 00 55")
BAUDS = (1_000_000, 57600)  # the servos' own comes last; QEMU rounds 1 Mbaud to 921600 on the host's side


def wait_for_adapter() -> str:
    """The adapter's link by id, laid as udev would: the device's number changes. Raises TimeoutError."""
    device = wait_until("an adapter at /dev/ttyUSB*", PLUG_S, lambda: next(Path("/dev").glob("ttyUSB*"), None))
    BY_ID.parent.mkdir(parents=True, exist_ok=True)
    BY_ID.unlink(missing_ok=True)
    BY_ID.symlink_to(device)
    return str(BY_ID)


def of_kernel(port: str) -> Path:
    """What the kernel tells of the adapter."""
    return Path("/sys/bus/usb-serial/devices", Path(port).resolve().name)


def check_adapter() -> None:
    """Everything the motion driver relies on, then unplugged while it is open."""
    with step("the kernel's ftdi_sio gives a port") as note:
        port = wait_for_adapter()
        driver = (of_kernel(port) / "driver").resolve().name
        expect(driver == "ftdi_sio", f"{port} belongs to {driver}")
        note(f"{port} → {Path(port).resolve()}, Linux {os.uname().release}")
    with step("latency timer is read and set") as note:
        timer = of_kernel(port) / "latency_timer"
        before = timer.read_text().strip()
        timer.write_text("1")
        note(f"{before} ms, then {timer.read_text().strip()} ms")
        expect(timer.read_text().strip() == "1", "the timer did not take 1 ms")
    with step("every baud is set, and a servo answers at its own") as note:
        for baud in BAUDS:
            with serial.Serial(port, baud, timeout=REPLY_S, exclusive=True) as line:
                line.write(PING)
                line.timeout = REPLY_S if baud == BAUDS[-1] else 0.3
                note(f"{baud}: {line.read(14).hex(' ') or 'silence'}")
                if baud == BAUDS[-1]:
                    line.write(PING)
                    reply = line.read(14)
                    expect(reply.startswith(STATUS_BEGINS) and len(reply) == 14, f"reply {reply.hex(' ')!r}")
    with step("a port that is held is refused to others") as note:
        note(exclusive(port))
    unplugged_while_open(port)


def exclusive(port: str) -> str:
    """What a second opening meets: pyserial's lock, and for programs without it TIOCEXCL, which root may pass."""
    Path(port).chmod(0o666)
    with serial.Serial(port, BAUDS[-1], exclusive=True) as line:
        fcntl.ioctl(line.fileno(), termios.TIOCEXCL)
        try:
            serial.Serial(port, BAUDS[-1], exclusive=True).close()
        except serial.SerialException as error:
            locked = f"second pyserial: {error}"
        else:
            raise AssertionError("pyserial opened an exclusive port twice")
        child = os.fork()
        if child == 0:
            os.setuid(65534)
            try:
                os.close(os.open(port, os.O_RDWR | os.O_NOCTTY))
            except OSError as error:
                os._exit(error.errno or 255)
            os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    expect(code == errno.EBUSY, f"another user's open() ended with code {code}")
    return f"{locked}; open() by another user: {os.strerror(code)}"


def unplugged_while_open(port: str) -> None:
    """What pyserial raises for each call when the adapter is pulled out."""
    with step("what pyserial raises when the adapter is pulled out") as note:
        line = serial.Serial(port, BAUDS[-1], timeout=0.5)
        held = Path(port).resolve()
        say("@open")
        wait_until(f"{port} to go", PLUG_S, lambda: not Path(port).exists())
        calls = {
            "read": lambda: line.read(1),
            "write": lambda: line.write(PING),
            "in_waiting": lambda: line.in_waiting,
            "reset_input_buffer": line.reset_input_buffer,
            "flush": line.flush,
            "baudrate": lambda: setattr(line, "baudrate", 115200),
        }
        for name, call in calls.items():
            note(f"{name} → {outcome(call)}")
    say("@pulled")
    with step("the adapter comes back under another number while the first is still held") as note:
        back = Path(wait_for_adapter()).resolve()
        note(f"{back}")
        expect(back != held, "it has the number of the port that is held")
        note(f"close → {outcome(line.close)}")


def outcome(call: object) -> str:
    """The exception of a call with the module it comes from, or what it returned."""
    assert callable(call)
    try:
        return repr(call())
    except Exception as error:
        kinds = f"{type(error).__module__}.{type(error).__qualname__}"
        return f"{kinds} (OSError: {isinstance(error, OSError)}): {error}"


if __name__ == "__main__":
    check_adapter()
