"""`viewsep bench servos`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from viewsep.cli.console import people, print_json, results


def servos(
    seconds: Annotated[float, typer.Option(min=0.2, max=600.0, help="How long every figure takes.")] = 2.0,
    baud: Annotated[int, typer.Option(help="Baud of the emulated servos.")] = 1_000_000,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Read 1, 2 and 3 emulated servos as fast as it goes, with the motion driver and with dynamixel-sdk alone.

    On a real line no more than `line Hz` is possible: the bytes of emulated servos take no time.

    Example:

        viewsep bench servos --seconds 2 --json
    """
    from viewsep.bench.servos import measure_servos

    with people.status("reading emulated servos"):
        figures = measure_servos(seconds, baud)
    if json:
        print_json(figures)
        return
    table = Table("what", "Hz", "CPU of a core", "bytes a cycle", f"line Hz at {baud}")
    for name, row in figures.items():
        share = f"{row['cpu_share']:.0%}"
        table.add_row(name, f"{row['hz']:.0f}", share, f"{row['bytes']:.0f}", f"{row['line_hz']:.0f}")
    results.print(table)
