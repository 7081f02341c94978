"""`viewsep camera doctor`."""

from __future__ import annotations

import typer
from rich.table import Table
from rich.text import Text

from viewsep.cli.camera_options import ConfigFile, Device, OptionalFormat, Rate, Size, chosen
from viewsep.cli.console import people, print_json, results
from viewsep.cli.service_options import Json
from viewsep.clock import MonotonicClock
from viewsep.drivers.checks import Check, Verdict
from viewsep.drivers.v4l2.doctor import examine
from viewsep.drivers.v4l2.system import THIS_MACHINE

COLOURS = {Verdict.GOOD: "green", Verdict.BETTER: "yellow", Verdict.BAD: "red"}


def doctor(
    config: ConfigFile = None,
    device: Device = None,
    format: OptionalFormat = None,
    size: Size = None,
    rate_hz: Rate = None,
    json: Json = False,
) -> None:
    """Look a camera over: access, settings, stamps, rate, drops, delay; says what to do about what is not right.

    The settings of the configuration are made. Exit codes: 0 all right, 1 something is wrong, 2 bad input.

    Examples:

        viewsep camera doctor --config rig.toml

        viewsep camera doctor --device /dev/video0 --format YUYV --size 320x240 --rate-hz 15
    """
    settings = chosen(config, device, format, size, rate_hz)
    checks: list[Check] = []
    with people.status("looking the camera over"):
        checks.extend(examine(settings, MonotonicClock(), THIS_MACHINE))
    if json:
        print_json(
            [{"check": c.name, "verdict": c.verdict.value, "found": c.found, "remedy": c.remedy} for c in checks]
        )
    else:
        table = Table("check", "", "found", "remedy")
        for c in checks:
            table.add_row(Text(c.name), Text(c.verdict.value, style=COLOURS[c.verdict]), Text(c.found), Text(c.remedy))
        results.print(table)
    if any(check.verdict is Verdict.BAD for check in checks):
        raise typer.Exit(1)
