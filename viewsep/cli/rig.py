"""`viewsep rig`: the servos of a rig."""

from __future__ import annotations

import typer

from viewsep.cli.rig_calibrate import calibrate
from viewsep.cli.rig_doctor import doctor
from viewsep.cli.rig_emulate import emulate
from viewsep.cli.rig_home import home
from viewsep.cli.rig_init import init
from viewsep.cli.rig_jog import jog
from viewsep.cli.rig_ports import ports
from viewsep.cli.rig_scan import scan

app = typer.Typer(help="Set up a rig's servos, or emulate them.", no_args_is_help=True, rich_markup_mode="markdown")
for command in (ports, scan, doctor, init, jog, home, calibrate, emulate):
    app.command()(command)
