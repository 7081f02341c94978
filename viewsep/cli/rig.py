"""`viewsep rig`: the servos of a rig."""

from __future__ import annotations

import typer

from viewsep.cli.rig_emulate import emulate

app = typer.Typer(help="Set up a rig's servos, or emulate them.", no_args_is_help=True, rich_markup_mode="markdown")
app.command()(emulate)
