"""`viewsep camera`: cameras that Linux has a driver for."""

from __future__ import annotations

import typer

from viewsep.cli.camera_doctor import doctor
from viewsep.cli.camera_focus import focus
from viewsep.cli.camera_list import list_cameras
from viewsep.cli.camera_snapshot import snapshot

app = typer.Typer(help="Set up a real camera.", no_args_is_help=True, rich_markup_mode="markdown")
app.command("list")(list_cameras)
for command in (doctor, snapshot, focus):
    app.command()(command)
