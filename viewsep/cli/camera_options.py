"""Which camera, and what it is set to: the same options for all commands that open one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from viewsep.camera_config import V4l2Config
from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.drivers.v4l2.camera import V4l2Camera
from viewsep.drivers.v4l2.listing import cameras
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.drivers.v4l2.system import THIS_MACHINE
from viewsep.errors import BadInput
from viewsep.v4l2_camera import v4l2_settings


class Format(StrEnum):
    """Of the pictures on their way."""

    MJPG = "MJPG"
    YUYV = "YUYV"


ConfigFile = Annotated[Path | None, typer.Option("--config", help="The rig's configuration.", show_default=False)]
Device = Annotated[
    str | None,
    typer.Option("--device", metavar="PATH", help="The camera.", show_default="the configuration's, or the only one"),
]
OptionalFormat = Annotated[
    Format | None, typer.Option("--format", help="Format on the way.", show_default="the configuration's, or MJPG")
]
Size = Annotated[
    str | None, typer.Option("--size", metavar="WxH", help="In pixels.", show_default="the configuration's, or 640x480")
]
Rate = Annotated[
    int | None, typer.Option("--rate-hz", min=1, help="Pictures a second.", show_default="the configuration's, or 30")
]


def chosen(
    config: Path | None, device: str | None, format: Format | None, size: str | None, rate_hz: int | None
) -> V4l2Settings:
    """The settings that the options ask for. Raises BadInput."""
    given = V4l2Config() if config is None else load_config(config).v4l2
    device = device or given.device or _only_one(config)
    settings = v4l2_settings(given.model_copy(update={"device": device}), str(config or "--device"))
    if format is not None:
        settings = replace(settings, format=format.value)
    if size is not None:
        width, height = _width_and_height(size)
        settings = replace(settings, width=width, height=height)
    if rate_hz is not None:
        settings = replace(settings, rate_hz=rate_hz)
    settings.check()
    return settings


@contextmanager
def opened(settings: V4l2Settings) -> Iterator[V4l2Camera]:
    """The camera, connected, and closed in the end. Raises RigError."""
    camera = V4l2Camera(settings, MonotonicClock(), THIS_MACHINE)
    camera.connect()
    try:
        yield camera
    finally:
        camera.close()


def _width_and_height(size: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", size)
    if match is None:
        raise BadInput(f"--size {size!r}: write WIDTHxHEIGHT, e.g. 640x480; `viewsep camera list` has the sizes")
    return int(match[1]), int(match[2])


def _only_one(config: Path | None) -> str:
    found = cameras(THIS_MACHINE)
    if len(found) == 1:
        return found[0].name
    if not found:
        raise BadInput("there is no camera: plug one in; `viewsep camera list` lists those there are")
    where = "--device" if config is None else f"--device, or v4l2.device in {config}"
    raise BadInput(f"there are {len(found)} cameras: give one with {where}: {', '.join(one.name for one in found)}")
