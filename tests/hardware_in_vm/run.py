"""Real drivers of Linux in a virtual machine, emulated servos on this side of its USB: `make test-hardware-in-vm`.

The adapter (FTDI, 0403:6001) is pulled out while a joint moves, and put back; the driver has to tell, then to go on.
Then a machine with Linux' own test camera (vivid): what OpenCV does with it, and the camera driver when it breaks.
What the machine says begins with `vm:`; the other steps are seen from here. Exit code 1 when a step fails; where QEMU
or the packages cannot be had it says so and skips.
"""

from __future__ import annotations

import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from machine import Device, Machine, require_qemu
from packages import Parts, Unavailable, parts
from steps import expect, say, step, wait_until

from viewsep.clock import MonotonicClock
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.presets import emulated_bus
from viewsep.sim.dynamixel.servo import EmulatedServo

GUEST = Path(__file__).with_name("guest_motion.py")
CAMERA_GUEST = Path(__file__).with_name("guest_camera.py")
MODULES = ["xhci_pci", "ftdi_sio"]
CAMERA_MODULES = ["vivid"]  # Linux' own test camera
USB: Device = {"driver": "qemu-xhci", "id": "usb"}
ADAPTER: Device = {"driver": "usb-serial", "id": "adapter", "bus": "usb.0", "chardev": "line"}
STEP_S = 60.0
CAMERA_S = 180.0
WATCHDOG_S = 3.0
TRIPPED = (-1, 0xFF)  # the register Bus Watchdog of a servo that has stopped by itself


def main() -> int:
    """The exit code."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the machine is ended, too
    begin = time.monotonic()
    try:
        require_qemu()
        made_of = parts()
    except Unavailable as reason:
        sys.stderr.write(f"SKIPPED: nothing was tested with real drivers in a virtual machine: {reason}\n")
        return 0
    say(f"the machine's parts are there ({time.monotonic() - begin:.1f} s)")
    run_steps(made_of)
    run_camera(made_of)
    say(f"all steps passed in {time.monotonic() - begin:.0f} s")
    return 0


def run_steps(made_of: Parts) -> None:
    """Every step; the first that fails ends the program."""
    with ExitStack() as stack:
        port = stack.enter_context(EmulatedPort(emulated_bus("pan_tilt", MonotonicClock())))
        with step("Debian's kernel boots on top of this machine's root"):
            line = f"serial,id=line,path={port.name}"  # tells the terminal also the baud that the guest sets
            machine = Machine(made_of, MODULES, [USB, ADAPTER], [sys.executable, GUEST], [line])
            stack.enter_context(machine)
        with step("the adapter is pulled out and put back"):
            machine.wait_for("open", STEP_S)
            machine.unplug(ADAPTER["id"])
            machine.wait_for("pulled", STEP_S)
            machine.plug(ADAPTER)
        with step("the adapter is pulled out in the middle of a move: the servo's own watchdog stops it") as note:
            machine.wait_for("moving", STEP_S)
            machine.unplug(ADAPTER["id"])
            note(watchdog(port.bus[1]))
        with step("the adapter is put back, and the guest ends well"):
            machine.wait_for("lost", STEP_S)
            machine.plug(ADAPTER)
            code = machine.wait_for("ended", STEP_S)
            expect(code == "0", f"the guest's program ended with code {code}")


def run_camera(made_of: Parts) -> None:
    """The camera's steps are all in the machine; the first that fails ends the program."""
    with ExitStack() as stack:
        with step("the kernel boots with a test camera"):
            machine = stack.enter_context(Machine(made_of, CAMERA_MODULES, [], [sys.executable, CAMERA_GUEST]))
        with step("the camera's driver does what it should, and the guest ends well"):
            code = machine.wait_for("ended", CAMERA_S)
            expect(code == "0", f"the guest's program ended with code {code}")


def watchdog(servo: EmulatedServo) -> str:
    """What stopped a servo that was moving. Raises TimeoutError, AssertionError."""
    begin = time.monotonic()
    expect(servo["Moving"] == 1, "it did not move any more when the adapter was out")
    wait_until("the servo to stand still", WATCHDOG_S, lambda: servo["Moving"] == 0)
    stood_s = time.monotonic() - begin
    expect(servo["Bus Watchdog"] in TRIPPED, f"its Bus Watchdog is {servo['Bus Watchdog']}: something else stopped it")
    return f"it stood {stood_s:.1f} s later at {servo.counts} of {servo['Goal Position']} counts"


if __name__ == "__main__":
    sys.exit(main())
