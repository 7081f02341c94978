"""`viewsep rig ports`."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.table import Table
from serial.tools.list_ports import comports

from viewsep.cli.console import people, print_json, results
from viewsep.cli.service_options import Json
from viewsep.drivers.dynamixel.port import usb_latency_s

BY_ID = Path("/dev/serial/by-id")


def ports(json: Json = False) -> None:
    """List serial ports, with the names that stay the same when an adapter is plugged in anew.

    Exit codes: 0 there are some, 1 there are none.
    """
    stable = {str(link.resolve()): str(link) for link in BY_ID.glob("*")}
    found = [
        {
            "port": port.device,
            "by_id": stable.get(port.device),
            "description": port.description,
            "latency_ms": None if (latency_s := usb_latency_s(port.device)) is None else round(latency_s * 1e3),
        }
        for port in sorted(comports())
    ]
    if json:
        print_json(found)
    elif found:
        table = Table("port", "name that stays", "description", "latency ms")
        for port in found:
            table.add_row(*("" if port[key] is None else str(port[key]) for key in port))
        results.print(table)
    else:
        people.print("no serial port: plug the adapter in, or try `viewsep rig emulate --preset pan_tilt`")
    if not found:
        raise typer.Exit(1)
