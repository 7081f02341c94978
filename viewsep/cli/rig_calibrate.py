"""`viewsep rig calibrate`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.cli.rig_dry_run import print_packets
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.cli.service_options import Json
from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.config_file import set_bus
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.errors import BadInput
from viewsep.repeatability import TARGETS, Repeatability, approaches, measure
from viewsep.servo_rig import hardware_settings

MARGIN = 3.0  # how many times the worst error the tolerance is to be
LARGEST_DEG = 10.0


def calibrate(
    config: Annotated[Path, typer.Option(help="The rig's configuration.", show_default=False)],
    joint: Annotated[str | None, typer.Option(help="Only this joint.", show_default="all")] = None,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="How often every target is approached.")] = 3,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the packets that would be sent.")] = False,
    json: Json = False,
) -> None:
    """Measure how well the joints come to rest, approaching the same angles from both sides.

    What their encoders see: play between servo and object needs a camera to be seen, and is not measured here. Where
    `settle_within_deg` is less than three times the worst error, it is raised; the file before is kept as FILE.bak.

    Examples:

        viewsep rig calibrate --config rig.toml

        viewsep rig calibrate --config rig.toml --joint pan --repeats 10 --json
    """
    loaded = load_config(config)
    settings = hardware_settings(loaded, str(config))
    names = [servo.joint.name for servo in settings.servos]
    if joint is not None and joint not in names:
        raise BadInput(f"--joint {joint!r}: the joints in {config} are {', '.join(names)}")
    chosen = range(len(names)) if joint is None else [names.index(joint)]
    if dry_run:
        limits = [servo.joint for servo in settings.servos]
        print_packets(
            settings, lambda at: [q for i in chosen for _, *both in approaches(limits[i], i, at, repeats) for q in both]
        )
        return
    clock = MonotonicClock()
    motion = DynamixelMotion(settings, clock)
    with interrupt_noted() as ended, progress_bar() as bar:
        task = bar.add_task("approaching", total=len(chosen) * repeats * len(TARGETS) * 2)

        watch = unless(ended, "stopped; nothing is saved")
        motion.connect()
        try:
            measured = [measure(motion, clock, index, repeats, lambda: bar.advance(task), watch) for index in chosen]
        finally:
            motion.close()
    worst_deg = max(float(np.degrees(one.worst_rad)) for one in measured)
    wanted_deg = min(LARGEST_DEG, math.ceil(MARGIN * worst_deg * 10.0) / 10.0)
    raised = wanted_deg > loaded.dynamixel.settle_within_deg
    if json:
        print_json([_as_dict(one) for one in measured])
    else:
        results.print(_table(measured))
    if raised:
        backup = set_bus(config, "settle_within_deg", wanted_deg)
        people.print(
            f"settle_within_deg = {wanted_deg:g} (the file before is {backup})", soft_wrap=True, highlight=False
        )
    else:
        people.print(f"settle_within_deg = {loaded.dynamixel.settle_within_deg:g} stays", highlight=False)


def _as_dict(one: Repeatability) -> dict[str, str | float]:
    return {
        "joint": one.joint,
        "from_below_deg": float(np.degrees(one.below_rad)),
        "from_above_deg": float(np.degrees(one.above_rad)),
        "dead_band_deg": float(np.degrees(one.dead_band_rad)),
        "spread_deg": float(np.degrees(one.spread_rad)),
        "worst_deg": float(np.degrees(one.worst_rad)),
    }


def _table(measured: list[Repeatability]) -> Table:
    table = Table("joint", "from below deg", "from above deg", "dead band deg", "spread deg", "worst deg")
    for one in measured:
        name, *values = _as_dict(one).values()
        table.add_row(str(name), *(f"{value:.3f}" for value in values))
    return table
