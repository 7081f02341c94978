"""`viewsep camera list`."""

from __future__ import annotations

from typing import Any

import typer
from rich.table import Table
from rich.text import Text

from viewsep.cli.console import people, print_json, results
from viewsep.cli.service_options import Json
from viewsep.drivers.v4l2.listing import Found, cameras
from viewsep.drivers.v4l2.node import Mode
from viewsep.drivers.v4l2.settings import FORMATS
from viewsep.drivers.v4l2.system import THIS_MACHINE


def list_cameras(json: Json = False) -> None:
    """List cameras by the names that stay when they are plugged in anew, with formats, sizes and rates.

    The table has the formats that viewsep reads, JSON has all. Exit codes: 0 there are some, 1 there are none.

    Examples:

        viewsep camera list

        viewsep camera list --json
    """
    found = cameras(THIS_MACHINE)
    if json:
        print_json([_as_dict(one) for one in found])
    elif found:
        results.print(_table(found))
    else:
        people.print("no camera: plug one in")
    if not found:
        raise typer.Exit(1)


def _table(found: tuple[Found, ...]) -> Table:
    table = Table("camera", "card", "driver", "format", "size: rates per second")
    for one in found:
        rows = [(name, _modes(one.modes, name)) for name in FORMATS]
        rows = [row for row in rows if row[1]] or [("", one.problem or f"none of {' and '.join(FORMATS)}")]
        for number, (name, modes) in enumerate(rows):
            who = (one.name, one.card, one.driver) if number == 0 else ("", "", "")
            table.add_row(*map(Text, (*who, name, modes)))
    return table


def _modes(modes: tuple[Mode, ...], format: str) -> str:
    return "\n".join(
        f"{mode.width}x{mode.height}: {', '.join(f'{rate:g}' for rate in mode.rates_hz) or '?'}"
        for mode in modes
        if mode.format == format
    )


def _as_dict(one: Found) -> dict[str, Any]:
    return {
        "camera": one.name,
        "node": one.node,
        "by_id": one.by_id or None,
        "by_path": one.by_path or None,
        "card": one.card,
        "driver": one.driver,
        "problem": one.problem,
        "modes": [
            {"format": m.format, "width": m.width, "height": m.height, "rates_hz": list(m.rates_hz)} for m in one.modes
        ],
    }
