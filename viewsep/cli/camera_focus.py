"""`viewsep camera focus`."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Annotated

import typer
from rich.live import Live
from rich.text import Text

from viewsep.cli.camera_options import ConfigFile, Device, OptionalFormat, Rate, Size, chosen, opened
from viewsep.cli.console import people, print_json_line, results
from viewsep.cli.rig_interrupt import interrupt_noted
from viewsep.cli.service_options import Json
from viewsep.clock import MonotonicClock
from viewsep.drivers.v4l2.pictures import sharpness

WAIT_S = 5.0
BAR = 40


def focus(
    config: ConfigFile = None,
    device: Device = None,
    format: OptionalFormat = None,
    size: Size = None,
    rate_hz: Rate = None,
    count: Annotated[int, typer.Option("--count", min=0, help="Pictures to look at; 0: until Ctrl-C.")] = 0,
    json: Json = False,
) -> None:
    """Show how sharp the picture is, while you turn the lens: the larger, the sharper; a full bar is the best.

    It is the variance of the picture's Laplacian: compare it only while nothing moves before the camera. Ctrl-C ends
    it with exit code 130. With --json a line each picture.

    Examples:

        viewsep camera focus --config rig.toml

        viewsep camera focus --device /dev/video0 --count 10 --json
    """
    settings, clock = chosen(config, device, format, size, rate_hz), MonotonicClock()
    best, seen = 0.0, 0
    with interrupt_noted() as ended, opened(settings) as camera, ExitStack() as stack:
        live = None
        if results.is_terminal and not json:
            live = stack.enter_context(Live(console=results, auto_refresh=False))
        while not ended() and (not count or seen < count):
            frame = camera.read(clock.now_ns(), WAIT_S)
            now = sharpness(frame.image)
            best, seen = max(best, now), seen + 1
            if json:
                print_json_line({"stamp_ns": frame.stamp_ns, "sharpness": now, "best": best})
            elif live is not None:
                live.update(_bar(now, best), refresh=True)
            else:
                results.print(_bar(now, best))
        if not json:
            people.print(f"the best was {best:.1f}", highlight=False)


def _bar(now: float, best: float) -> Text:
    filled = round(BAR * now / best) if best > 0 else 0
    return Text(f"{now:10.1f} {'█' * filled}{'·' * (BAR - filled)} best {best:.1f}")
