"""`viewsep recordings`: what is in recordings, how two differ, and what becomes of them elsewhere."""

from __future__ import annotations

import typer

from viewsep.cli.recordings_diff import diff
from viewsep.cli.recordings_export import export
from viewsep.cli.recordings_info import info

app = typer.Typer(
    help="Look into recordings, compare and convert them.", no_args_is_help=True, rich_markup_mode="markdown"
)
for command in (info, diff, export):
    app.command()(command)
