"""`viewsep rig scan`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.cli.service_options import Json
from viewsep.drivers.dynamixel.bus import BAUDS, Found
from viewsep.drivers.dynamixel.bus import scan as scan_bus
from viewsep.errors import BadInput

Port = Annotated[str, typer.Option(help="Serial port of the servos.", show_default=False, metavar="PORT")]


def scan(
    port: Port,
    baud: Annotated[list[int] | None, typer.Option(help="Only this baud (repeatable).", show_default="all")] = None,
    json: Json = False,
) -> None:
    """Find every servo on a port: all ids, at every baud. Takes about a second a baud.

    Exit codes: 0 found some, 1 found none, 2 bad input.

    Examples:

        viewsep rig scan --port /dev/ttyUSB0

        viewsep rig scan --port /dev/ttyUSB0 --baud 57600 --json
    """
    bauds = tuple(baud) if baud else BAUDS
    for wrong in set(bauds) - set(BAUDS):
        raise BadInput(f"--baud {wrong}: servos know {', '.join(str(known) for known in sorted(BAUDS))}")
    found: list[Found] = []
    with progress_bar() as bar:
        task = bar.add_task("scanning", total=len(bauds))
        for tried, servos in scan_bus(port, bauds):
            found += servos
            bar.update(task, advance=1, description=f"scanned {tried} baud")
    if json:
        print_json([{"id": s.servo_id, "model": s.model, "firmware": s.firmware, "baud": s.baud} for s in found])
    elif found:
        table = Table("id", "model", "firmware", "baud")
        for s in found:
            table.add_row(str(s.servo_id), s.model, str(s.firmware), str(s.baud))
        results.print(table)
    else:
        people.print(f"no servo answers on {port}: check power and cables, and that it is the right port")
    if not found:
        raise typer.Exit(1)
