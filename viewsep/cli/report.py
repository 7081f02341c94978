"""`viewsep report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import results
from viewsep.recordings.reader import read_recording


def report(
    recording: Annotated[Path, typer.Argument(help="Recording (MCAP).", metavar="FILE", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Picture to write (PNG).")] = Path("report.png"),
) -> None:
    """Draw what happened in a recording: paths on the view sphere, ratings, comparisons, the views that decided.

    Example:

        viewsep report run.mcap -o run.png
    """
    from viewsep.plots.report import report as draw  # matplotlib is slow to import

    draw(read_recording(recording), output)
    results.print(f"report: {output}", soft_wrap=True)
