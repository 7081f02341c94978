"""Changing single values of a configuration file: comments and order stay, and so does a copy of how it was."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tomlkit

from viewsep.config import load_config, parse_config
from viewsep.files import write_whole


def change(path: Path, edit: Callable[[Any], None]) -> Path:
    """Apply `edit` to the parsed file, check the outcome, and write it; returns where the file before is kept.

    Raises BadConfig, BadInput; the file is unchanged then.
    """
    path = path.resolve()  # a link stays one
    load_config(path)
    before = path.read_bytes()
    document = tomlkit.parse(before.decode())
    edit(document)
    after = tomlkit.dumps(document)
    parse_config(tomllib.loads(after), str(path))
    backup = _unused(path)
    write_whole(backup, before, "copy of the configuration")
    write_whole(path, after.encode(), "configuration")
    return backup


def set_servo(path: Path, joint: int, key: str, value: float | int) -> Path:
    """Set one key of a joint's servo."""

    def edit(document: Any) -> None:
        document["dynamixel"]["servos"][joint][key] = value

    return change(path, edit)


def set_bus(path: Path, key: str, value: float | int) -> Path:
    """Set one key of the bus."""

    def edit(document: Any) -> None:
        document["dynamixel"][key] = value

    return change(path, edit)


def set_timing(path: Path, latency_s: float, backlash_deg: Sequence[float]) -> Path:
    """Set how late the camera's stamps are, and the play of every joint."""

    def edit(document: Any) -> None:
        document.setdefault("camera", tomlkit.table())["latency_s"] = latency_s
        document.setdefault("rig", tomlkit.table())["backlash_deg"] = list(backlash_deg)

    return change(path, edit)


def set_placement(path: Path, camera_elevation_deg: float, axes: Sequence[Sequence[float]]) -> Path:
    """Set the camera's elevation, and the axes of joints that are written out where any are given."""

    def edit(document: Any) -> None:
        rig = document.setdefault("rig", tomlkit.table())
        rig["camera_elevation_deg"] = camera_elevation_deg
        for joint, axis in zip(rig.get("joints", []), axes, strict=False):
            joint["axis"] = list(axis)

    return change(path, edit)


def _unused(path: Path) -> Path:
    """A name for the copy that nothing has."""
    number = 0
    while (backup := path.with_name(f"{path.name}.bak{f'.{number}' if number else ''}")).exists():
        number += 1
    return backup
