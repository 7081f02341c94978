"""What the machine is made of, from Debian's packages: a kernel with its modules, a static busybox; kept in a cache."""

from __future__ import annotations

import lzma
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

KERNEL_PACKAGE = "linux-image-amd64"  # not the cloud kernel: that one has no USB
CACHE = user_cache_path("viewsep") / "vm"
DOWNLOAD_S = 300.0
XZ = b"\xfd7zXZ\0"


class Unavailable(Exception):
    """Something the machine needs cannot be had here; the text says what, and how to get it."""


@dataclass(frozen=True)
class Parts:
    """Files of the machine: the kernel's image, the folder of its modules and a static busybox."""

    image: Path
    modules: Path
    busybox: Path

    def needed(self, names: list[str]) -> list[Path]:
        """Module files in the order in which they are to be loaded: each after all that it depends on.

        Raises Unavailable for a module that the kernel does not have.
        """
        files = {_plain(path.name.split(".")[0]): path for path in self.modules.rglob("*.ko*")}
        built_in = {_plain(Path(line).stem) for line in (self.modules / "modules.builtin").read_text().split()}
        order: dict[str, Path] = {}

        def add(name: str) -> None:
            if name in order or name in built_in:
                return
            if name not in files:
                raise Unavailable(f"the kernel {self.modules.name} has no module {name!r}")
            for needs in _depends(module_bytes(files[name])):
                add(needs)
            order[name] = files[name]

        for name in names:
            add(_plain(name))
        return list(order.values())


def module_bytes(path: Path) -> bytes:
    """The module as the kernel takes it; newer releases of Debian compress them."""
    return lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()


def parts() -> Parts:
    """The machine's parts, downloaded when they are not in the cache. Raises Unavailable."""
    return _found() or _downloaded()


def _found() -> Parts | None:
    images, modules = sorted(CACHE.glob("boot/vmlinuz-*")), sorted(CACHE.glob("lib/modules/*"))
    busybox = CACHE / "bin" / "busybox"
    if not (images and modules and busybox.is_file()):
        return None
    return Parts(images[-1], modules[-1], busybox)


def _uncompressed(image: Path) -> None:
    """Unpack the kernel here: done by an emulated processor it would double the time to boot."""
    data = image.read_bytes()
    begin = data.find(XZ)
    if begin > 0:  # others boot as they are
        image.write_bytes(lzma.LZMADecompressor().decompress(data[begin:]))


def _downloaded() -> Parts:
    for tool in ("apt-get", "apt-cache", "dpkg-deb"):
        if shutil.which(tool) is None:
            raise Unavailable(f"{tool} is missing: the kernel and busybox come from Debian's packages")
    packages = [_kernel_package(), "busybox-static"]
    CACHE.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="vm-", dir=CACHE.parent) as made:
        folder = Path(made)
        _run("apt-get", "download", *packages, folder=folder)
        for package in folder.glob("*.deb"):
            _run("dpkg-deb", "--extract", str(package), "whole", folder=folder)
            package.unlink()
        for image in folder.glob("whole/boot/vmlinuz-*"):
            _uncompressed(image)
        shutil.rmtree(CACHE, ignore_errors=True)
        (folder / "whole").rename(CACHE)
    found = _found()
    if found is None:
        raise Unavailable(f"the packages {' and '.join(packages)} hold no kernel, modules and busybox where expected")
    return found


def _kernel_package() -> str:
    depends = _run("apt-cache", "depends", KERNEL_PACKAGE, folder=Path("/"))
    name = re.search(r"Depends: (linux-image-\S+)", depends)
    if name is None:
        raise Unavailable(
            f"Debian's package {KERNEL_PACKAGE} is not to be had: run `apt-get update` on a Debian machine"
        )
    return name[1]


def _run(*command: str, folder: Path) -> str:
    try:
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=DOWNLOAD_S)
    except subprocess.TimeoutExpired as error:
        raise Unavailable(f"`{' '.join(command)}` did not end within {DOWNLOAD_S:.0f} s: try again") from error
    if ended.returncode:
        reason = ended.stderr.strip().splitlines()[-1:] or ["no reason given"]
        raise Unavailable(f"`{' '.join(command)}` failed ({reason[0]}): run `apt-get update` and try again")
    return ended.stdout


def _plain(name: str) -> str:
    return name.replace("-", "_")


def _depends(module: bytes) -> list[str]:
    line = re.search(rb"\0depends=([^\0]*)\0", module)
    return [_plain(name) for name in line[1].decode().split(",") if name] if line else []
