"""`viewsep rig`: the servos of a rig."""

from __future__ import annotations

import typer

from viewsep.cli.default_command import DefaultsToFirst
from viewsep.cli.rig_background import background
from viewsep.cli.rig_board import board
from viewsep.cli.rig_calibrate import calibrate
from viewsep.cli.rig_calibrate_board import calibrate_board
from viewsep.cli.rig_calibrate_camera import calibrate_camera
from viewsep.cli.rig_doctor import doctor
from viewsep.cli.rig_emulate import emulate
from viewsep.cli.rig_home import home
from viewsep.cli.rig_init import init
from viewsep.cli.rig_jog import jog
from viewsep.cli.rig_ports import ports
from viewsep.cli.rig_scan import scan
from viewsep.cli.rig_set_id import set_id

app = typer.Typer(help="Set up a rig's servos, or emulate them.", no_args_is_help=True, rich_markup_mode="markdown")
for command in (ports, scan, set_id, doctor, init, jog, home, emulate, board, background):
    app.command()(command)

calibrating = typer.Typer(
    cls=DefaultsToFirst,
    help="""Measure a rig: how joints come to rest (where nothing else is named), latency and play, camera and axes.

    Examples:

        viewsep rig calibrate --config rig.toml

        viewsep rig calibrate camera --config rig.toml

        viewsep rig calibrate board pictures --config rig.toml
    """,
    rich_markup_mode="markdown",
)
calibrating.command("joints")(calibrate)
calibrating.command("camera")(calibrate_camera)
calibrating.command("board")(calibrate_board)
app.add_typer(calibrating, name="calibrate")
