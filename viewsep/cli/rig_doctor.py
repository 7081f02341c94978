"""`viewsep rig doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from viewsep.cli.console import print_json, results
from viewsep.cli.service_options import Json
from viewsep.config import load_config
from viewsep.drivers.checks import Check, Verdict
from viewsep.drivers.dynamixel.bus import BAUDS, Bus
from viewsep.drivers.dynamixel.doctor import examine
from viewsep.drivers.dynamixel.settings import ServoSettings
from viewsep.errors import BadInput
from viewsep.servo_rig import hardware_settings

COLOURS = {Verdict.GOOD: "green", Verdict.BETTER: "yellow", Verdict.BAD: "red"}


def doctor(
    config: Annotated[Path | None, typer.Option(help="The rig's configuration.", show_default=False)] = None,
    port: Annotated[str | None, typer.Option(help="A port, without a configuration.", metavar="PORT")] = None,
    baud: Annotated[int, typer.Option(help="Baud with --port.")] = 57600,
    fix: Annotated[bool, typer.Option("--fix", help="Set the servos' return delay to 0.")] = False,
    json: Json = False,
) -> None:
    """Look the servos over: port, cables, supply, limits, settings; says what to do about what is not right.

    Nothing moves, and nothing is changed without --fix. Exit codes: 0 all right, 1 something is wrong, 2 bad input.

    Examples:

        viewsep rig doctor --config rig.toml

        viewsep rig doctor --port /dev/ttyUSB0 --baud 1000000
    """
    wanted: tuple[ServoSettings, ...] = ()
    if (config is None) == (port is None):
        raise BadInput("give --config FILE, or --port PORT where there is none yet")
    if config is not None:
        settings = hardware_settings(load_config(config), str(config))
        port, baud, wanted = settings.port, settings.baud, settings.servos
    if baud not in BAUDS:
        raise BadInput(f"--baud {baud}: servos know {', '.join(str(known) for known in sorted(BAUDS))}")
    assert port is not None
    bus = Bus(port, baud)
    try:
        checks = list(examine(bus, wanted, fix))
    finally:
        bus.close()
    if json:
        print_json(
            [{"check": c.name, "verdict": c.verdict.value, "found": c.found, "remedy": c.remedy} for c in checks]
        )
    else:
        results.print(_table(checks))
    if any(check.verdict is Verdict.BAD for check in checks):
        raise typer.Exit(1)


def _table(checks: list[Check]) -> Table:
    table = Table("check", "", "found", "remedy")
    for check in checks:
        verdict = Text(check.verdict.value, style=COLOURS[check.verdict])
        table.add_row(Text(check.name), verdict, Text(check.found), Text(check.remedy))
    return table
