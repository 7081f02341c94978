"""`viewsep bench recording`."""

from __future__ import annotations

import math
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from viewsep.cli.console import MAX_SEED, print_json, progress_bar, results


def recording(
    seconds: Annotated[float, typer.Option(min=1.0, max=86_400.0, help="How long.")] = 60.0,
    rate_hz: Annotated[float, typer.Option(min=1.0, max=1000.0, help="Pictures and percepts a second.")] = 60.0,
    width: Annotated[int, typer.Option(min=64, max=8192, help="Of the pictures, pixels.")] = 640,
    height: Annotated[int, typer.Option(min=64, max=8192, help="Of the pictures, pixels.")] = 480,
    folder: Annotated[Path | None, typer.Option(help="Disk to write to.", show_default="temporary folder")] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the pictures.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Record pictures and percepts at a steady rate: what is lost, what waits, what it costs in time and memory.

    Pictures are made up, about as hard to compress as those of a camera. Exit code 1 when messages were lost.

    Example:

        viewsep bench recording --seconds 60 --folder recordings --json
    """
    from viewsep.bench.recording import measure_recording

    with tempfile.TemporaryDirectory(dir=folder) as place, progress_bar() as progress:
        bar = progress.add_task("recording", total=math.ceil(seconds))
        found = measure_recording(Path(place), seconds, rate_hz, (height, width), seed, lambda: progress.advance(bar))
    if json:
        print_json({**asdict(found), "rss_spread_mb": found.rss_spread_mb})
    else:
        table = Table("what", "figure")
        table.add_row(
            "recorded", f"{found.messages} messages, {found.frames} of them pictures, in {found.seconds:.1f} s"
        )
        table.add_row("lost", str(found.lost))
        table.add_row("waiting at most", f"{found.fullest} messages")
        table.add_row("file", f"{found.file_mb:.1f} MB, {found.mb_per_s:.1f} MB/s")
        table.add_row("CPU of a core", f"{found.cpu_share:.0%}, {found.cpu_share_idle:.0%} of it without a recorder")
        table.add_row("slowest call", f"{found.late_ms:.1f} ms")
        table.add_row("memory", f"{found.rss_mb[-1]:.0f} MB, within {found.rss_spread_mb:.1f} MB")
        results.print(table)
    if found.lost:
        raise typer.Exit(1)
