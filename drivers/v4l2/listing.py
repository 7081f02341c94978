"""Which cameras there are, the names under which they stay, and who uses them."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from viewsep.drivers.v4l2.errors import CameraLost
from viewsep.drivers.v4l2.node import Mode, Node
from viewsep.drivers.v4l2.system import THIS_MACHINE, System


@dataclass(frozen=True, slots=True)
class Found:
    """A camera: its node, the names that stay when it is plugged in anew, and what it can.

    `problem` says why nothing more is known of it; empty when all is well.
    """

    node: str
    by_id: str
    by_path: str
    card: str
    driver: str = ""
    modes: tuple[Mode, ...] = ()
    problem: str = ""

    @property
    def name(self) -> str:
        """The best name for a configuration: by id, which follows the camera; by path, which follows the socket."""
        return self.by_id or self.by_path or self.node


def cameras(system: System = THIS_MACHINE) -> tuple[Found, ...]:
    """All nodes that give pictures, in order of their numbers."""
    found = (_found(entry, system) for entry in sorted(system.sysfs.glob("video*"), key=_number))
    return tuple(one for one in found if one is not None)


def stable_name(path: str, system: System = THIS_MACHINE) -> str:
    """The name of a node that stays when it is plugged in anew; `path` where there is none."""
    for folder in ("by-id", "by-path"):
        if link := _link(Path(path), folder, system):
            return link
    return path


def holders(path: str, system: System = THIS_MACHINE) -> tuple[str, ...]:
    """Other processes that have a node open, as `1234 (cheese)`; only those that this user may look at."""
    node, found = os.path.realpath(path), []
    for process in sorted(system.proc.glob("[0-9]*"), key=lambda folder: int(folder.name)):
        if int(process.name) == os.getpid():
            continue
        with suppress(OSError):
            if any(_points_at(file, node) for file in (process / "fd").iterdir()):
                found.append(f"{process.name} ({(process / 'comm').read_text().strip()})")
    return tuple(found)


def _points_at(file: Path, node: str) -> bool:
    try:
        return str(file.readlink()) == node
    except OSError:  # closed meanwhile
        return False


def _found(entry: Path, system: System) -> Found | None:
    """None for a node that gives no pictures."""
    node = system.dev / entry.name
    try:
        card = (entry / "name").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:  # unplugged meanwhile
        return None
    by_id, by_path = _link(node, "by-id", system), _link(node, "by-path", system)
    try:
        with Node(node, system) as opened:
            capability = opened.capability()
            if not capability.captures:
                return None
            return Found(str(node), by_id, by_path, capability.card, capability.driver, opened.modes())
    except CameraLost as error:
        return Found(str(node), by_id, by_path, card, problem=str(error))


def _link(node: Path, folder: str, system: System) -> str:
    links = sorted((system.dev / "v4l" / folder).glob("*"))
    return next((str(link) for link in links if link.resolve() == node.resolve()), "")


def _number(entry: Path) -> int:
    digits = entry.name.removeprefix("video")
    return int(digits) if digits.isdigit() else -1
