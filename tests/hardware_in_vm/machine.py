"""A virtual machine with a real Linux kernel and drivers, in which a program of the host's root runs.

    usb, adapter = {"driver": "qemu-xhci", "id": "usb"}, {"driver": "usb-serial", "id": "adapter", "chardev": "line"}
    chardevs = ["serial,id=line,path=/dev/pts/5"]
    with Machine(parts(), ["xhci_pci", "ftdi_sio"], [usb, adapter], ["python3", "guest.py"], chardevs) as machine:
        machine.wait_for("ready", 60.0)  # the guest's program prints "@ready"
        machine.unplug("adapter")

QEMU emulates the processor (TCG): that works everywhere, while KVM inside another virtual machine may hang.
The host's root is there over 9p, read-only; what the program writes goes to memory and is gone at the end.
"""

from __future__ import annotations

import json
import queue
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from initramfs import write_initramfs
from packages import Parts, Unavailable
from qmp import Qmp

QEMU = "qemu-system-x86_64"
ROOT_MODULES = ["virtio_pci", "9pnet_virtio", "9p", "overlay"]
PROCESSOR = "Nehalem"  # the least that numpy's wheels run on; with more, TCG is slower
LIFE_S = 300  # the machine ends itself then, should this process be killed
CONSOLE_LINES = 15  # of the kernel's last words, shown when something goes wrong
BOOT_S = 120.0
END_S = 10.0

Device = dict[str, Any]  # what QEMU's -device and device_add take; "driver" is its kind


class Broken(Exception):
    """The machine did not do what it should within its deadline; the text says what."""


def show(line: str) -> None:
    """Print a line as one of the machine's."""
    sys.stdout.write(f"  vm: {line}\n")
    sys.stdout.flush()


def require_qemu() -> None:
    """Raises Unavailable where there is no QEMU."""
    if shutil.which(QEMU) is None:
        raise Unavailable(f"{QEMU} is missing: `apt-get install --no-install-recommends qemu-system-x86`")


class Machine:
    """Boots on `with`; ends with it. `chardevs` are QEMU's -chardev options that the devices name."""

    def __init__(
        self,
        parts: Parts,
        modules: Sequence[str],
        devices: Sequence[Device],
        guest_command: Sequence[str | Path],
        chardevs: Sequence[str] = (),
    ) -> None:
        require_qemu()
        self._parts = parts
        self._modules = [*ROOT_MODULES, *modules]
        self._devices = list(devices)
        self._command = shlex.join(map(str, guest_command))
        self._chardevs = list(chardevs)
        self._lines: queue.Queue[str | None] = queue.Queue()

    def __enter__(self) -> Self:
        self._folder = Path(tempfile.mkdtemp(prefix="viewsep-vm-"))
        self._console = self._folder / "console"
        try:
            write_initramfs(self._folder / "initramfs", self._parts, self._modules, self._command)
            self._process = subprocess.Popen(
                self._qemu(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
            )
        except BaseException:
            shutil.rmtree(self._folder)
            raise
        self._reader = threading.Thread(target=self._read, name="machine", daemon=True)
        self._reader.start()
        try:
            self._qmp = Qmp(self._folder / "qmp", BOOT_S, lambda: self._process.poll() is None)
            self.wait_for("booted", BOOT_S)
        except BaseException:
            self._end(failed=True)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._qmp.close()
        self._end(failed=kind is not None)

    def _end(self, *, failed: bool) -> None:
        """End QEMU, by its own id, and remove its files; after a failure show what it said last."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait(END_S)
        self._reader.join(END_S)
        if failed:
            while (line := self._lines.get()) is not None:
                show(line)
            console = self._console.read_text(errors="replace") if self._console.exists() else ""
            for line in console.splitlines()[-CONSOLE_LINES:]:
                show(line)
        shutil.rmtree(self._folder, ignore_errors=True)

    def wait_for(self, sign: str, timeout_s: float) -> str:
        """Show the guest's lines until it says `@sign`; what follows on that line. Raises Broken after the deadline."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise Broken(f"the machine did not say {sign!r} within {timeout_s:.0f} s") from None
            if line is None:
                raise Broken(f"the machine ended before it said {sign!r}")
            said, _, rest = line.partition(" ")
            if said == f"@{sign}":
                return rest
            if said == "@ended":
                raise Broken(f"the guest's program ended with code {rest} before it said {sign!r}")
            show(line)

    def plug(self, device: Device) -> None:
        """Plug a device in while the machine runs."""
        self._qmp.ask("device_add", **device)

    def unplug(self, name: str) -> None:
        """Pull a device out and wait until it is gone."""
        self._qmp.ask("device_del", id=name)
        self._qmp.wait_for("DEVICE_DELETED", END_S)

    def _qemu(self) -> list[str]:
        command = [QEMU, "-accel", "tcg", "-machine", "pc", "-cpu", PROCESSOR, "-smp", "1", "-m", "512"]
        command += ["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none"]
        command += ["-kernel", str(self._parts.image), "-initrd", str(self._folder / "initramfs")]
        command += ["-append", f"console=ttyS0 quiet panic=-1 mitigations=off end_after_s={LIFE_S}"]
        command += ["-serial", f"file:{self._console}", "-serial", "stdio"]
        command += ["-qmp", f"unix:{self._folder / 'qmp'},server=on,wait=off"]
        command += ["-fsdev", "local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"]
        command += ["-device", "virtio-9p-pci,fsdev=host,mount_tag=host"]
        for chardev in self._chardevs:
            command += ["-chardev", chardev]
        for device in self._devices:
            command += ["-device", json.dumps(device)]
        return command

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.decode(errors="replace").rstrip())
        self._lines.put(None)
