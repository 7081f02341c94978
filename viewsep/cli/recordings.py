"""`viewsep recordings`: what is in recordings, how two differ, what becomes of them elsewhere, what can be saved."""

from __future__ import annotations

import typer

from viewsep.cli.recordings_diff import diff
from viewsep.cli.recordings_export import export
from viewsep.cli.recordings_info import info
from viewsep.cli.recordings_recover import recover

app = typer.Typer(
    help="Look into recordings, compare, convert and save them.", no_args_is_help=True, rich_markup_mode="markdown"
)
for command in (info, diff, export, recover):
    app.command()(command)
