"""The machine's first file system: busybox, the modules and the script `init`, as a compressed cpio archive."""

from __future__ import annotations

import gzip
import stat
from pathlib import Path

from packages import Parts, module_bytes

INIT = Path(__file__).with_name("init")


def write_initramfs(target: Path, parts: Parts, modules: list[str], command: str) -> None:
    """Write the archive. `init` runs `command` with the host's /bin/sh on top of the host's root."""
    archive = Archive()
    for folder in ("bin", "dev", "lib", "modules", "overlay", "proc", "host", "sys"):
        archive.add(folder, b"", stat.S_IFDIR | 0o755)
    archive.add("bin/busybox", parts.busybox.read_bytes(), stat.S_IFREG | 0o755)
    archive.add("init", INIT.read_bytes(), stat.S_IFREG | 0o755)
    archive.add("command", command.encode(), stat.S_IFREG | 0o644)
    for number, path in enumerate(parts.needed(modules)):
        archive.add(f"modules/{number:02}-{path.name.split('.')[0]}.ko", module_bytes(path), stat.S_IFREG | 0o644)
    target.write_bytes(gzip.compress(archive.ended(), compresslevel=1))


class Archive:
    """A cpio archive in the format `newc`, which the kernel unpacks."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._inode = 0

    def add(self, name: str, data: bytes, mode: int) -> None:
        """Append a file or folder; `mode` has its kind and permissions."""
        self._inode += 1
        owner, links, time, device = 0, 1, 0, 0
        numbers = (self._inode, mode, owner, owner, links, time, len(data), *(device,) * 4, len(name) + 1, 0)
        self._pad(b"070701" + "".join(f"{number:08x}" for number in numbers).encode() + name.encode() + b"\0")
        self._pad(data)

    def ended(self) -> bytes:
        """The whole archive."""
        self.add("TRAILER!!!", b"", 0)
        return bytes(self._data)

    def _pad(self, data: bytes) -> None:
        self._data += data + bytes(-len(data) % 4)
