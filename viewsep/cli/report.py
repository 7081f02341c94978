"""`viewsep report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import results
from viewsep.errors import BadInput
from viewsep.recordings.reader import read_recording


def report(
    recording: Annotated[Path, typer.Argument(help="Recording (MCAP).", metavar="FILE", show_default=False)],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="What to write: a page (.html) or a picture (.png).")
    ] = Path("report.png"),
) -> None:
    """Tell what happened in a recording: pictures, paths on the view sphere, ratings, comparisons, what decided.

    A page is one file that needs no network and goes into every detail; a picture tells it at a glance.

    Examples:

        viewsep report run.mcap -o run.html

        viewsep report run.mcap -o run.png
    """
    kind = output.suffix.lower()
    if kind not in (".html", ".png"):
        raise BadInput(f"--output {output}: a report is a page or a picture: give a name that ends in .html or .png")
    content = read_recording(recording)
    if kind == ".html":
        from viewsep.plots.page import write_page  # matplotlib is slow to import

        write_page(content, output, recording.name)
    else:
        from viewsep.plots.report import report as draw

        draw(content, output)
    results.print(f"report: {output}", soft_wrap=True)
