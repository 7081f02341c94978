"""`viewsep bench service`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from viewsep.cli.console import MAX_SEED, people, print_json, results


def service(
    seconds: Annotated[float, typer.Option(min=1.0, max=3600.0, help="How long every figure takes.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the simulated rig.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Serve a simulated rig in real time in a process of its own and time status, pictures and moves over 127.0.0.1.

    Example:

        viewsep bench service --seconds 5 --json
    """
    from viewsep.bench.service import measure_service

    with people.status("starting") as shown:
        figures = measure_service(seconds, seed, shown.update)
    if json:
        print_json(figures)
        return
    table = Table("what", "p50 ms", "p99 ms", "samples")
    for name, row in figures.items():
        table.add_row(name, f"{row['p50_ms']:.2f}", f"{row['p99_ms']:.2f}", f"{row['samples']:.0f}")
    results.print(table)
