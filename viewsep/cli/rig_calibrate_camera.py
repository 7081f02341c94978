"""`viewsep rig calibrate camera`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from viewsep.calibration.latency import Interval, Timing, agreed
from viewsep.calibration.turning import measure_timing, part_with_object, ticks_of
from viewsep.cli.console import MAX_SEED, people, print_json, progress_bar, results
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.cli.service_options import Json
from viewsep.config import load_config
from viewsep.config_file import set_timing
from viewsep.errors import BadInput, try_all
from viewsep.perception.setup import finder_of
from viewsep.rigs import is_real, rig_for

UNSURE_S, UNSURE_DEG = 0.02, 0.5  # wider intervals are not stored


def calibrate_camera(
    config: Annotated[Path, typer.Option(help="The rig's configuration.", show_default=False)],
    object_: Annotated[
        str | None,
        typer.Option(
            "--object",
            help="What a simulated camera sees in the holder, as for `viewsep learn`.",
            show_default="generated:7",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of how it is held, in simulation.")] = 0,
    keep: Annotated[bool, typer.Option("--keep", help="Leave the configuration as it is.")] = False,
    json: Json = False,
) -> None:
    """Find how late the camera's stamps are and how much play every joint has, by turning an object both ways.

    Put an object with print all around into the holder; every joint turns to and fro over some 90 degrees. What was
    found goes into the configuration as `camera.latency_s` and `rig.backlash_deg`; the file before is kept as FILE.bak.

    Examples:

        viewsep rig calibrate camera --config rig.toml

        viewsep rig calibrate camera --config rig.toml --keep --json
    """
    settings = load_config(config)
    built = rig_for(settings, object_ or ("" if is_real(settings) else "generated:7"), seed)
    rig = built.rig
    limits = rig.motion.limits()
    finder, measured = finder_of(settings), list[Timing]()
    with interrupt_noted() as ended, progress_bar() as bar:
        watch = unless(ended, "stopped; nothing is saved")
        rig.motion.connect()
        try:
            rig.camera.connect()
            at = rig.motion.read_state().position_rad
            task = bar.add_task(
                "turning", total=sum(ticks_of(limit, angle) for limit, angle in zip(limits, at, strict=True))
            )
            part = part_with_object(rig, finder)
            for joint in range(len(limits)):
                measured.append(measure_timing(rig, joint, lambda: bar.advance(task), watch, part))
        finally:
            try_all((rig.motion.close, rig.camera.close))
    names = [limit.name for limit in limits]
    latency = agreed([one.latency_s for one in measured])
    if json:
        print_json({"rig": built.described, "latency_s": _interval(latency), "joints": _rows(names, measured)})
    else:
        results.print(_table(names, measured))
        people.print(f"seen by: {built.described}", soft_wrap=True, highlight=False)
    _check(names, measured, latency)
    if keep:
        return
    backlash_deg = [round(float(np.degrees(one.play_rad.value)), 3) for one in measured]
    backup = set_timing(config, round(latency.value, 4), backlash_deg)
    people.print(
        f"latency_s = {latency.value:.4f}, backlash_deg = {backlash_deg} (the file before is {backup})",
        soft_wrap=True,
        highlight=False,
    )


def _check(names: Sequence[str], measured: Sequence[Timing], latency: Interval) -> None:
    """Raises BadInput for what is not known well enough to be stored."""
    if latency.margin > UNSURE_S:
        raise BadInput(
            f"the latency is {1e3 * latency.value:.0f} ms within {1e3 * latency.margin:.0f} ms only: nothing is "
            "stored; use steady light and an object with more print"
        )
    for name, one in zip(names, measured, strict=True):
        margin = float(np.degrees(one.play_rad.margin))
        if margin > UNSURE_DEG:
            raise BadInput(
                f"the play of joint {name!r} is {np.degrees(one.play_rad.value):.1f} deg within {margin:.1f} deg only: "
                "nothing is stored; use an object with more print, held firmly"
            )


def _interval(one: Interval) -> dict[str, float]:
    return {"value": one.value, "margin": one.margin}


def _rows(names: Sequence[str], measured: Sequence[Timing]) -> list[dict[str, Any]]:
    return [
        {
            "joint": name,
            "latency_s": _interval(one.latency_s),
            "backlash_deg": {
                "value": float(np.degrees(one.play_rad.value)),
                "margin": float(np.degrees(one.play_rad.margin)),
            },
            "residual_deg": float(np.degrees(one.residual_rad)),
            "frames": one.used,
            "rejected": one.rejected,
        }
        for name, one in zip(names, measured, strict=True)
    ]


def _table(names: Sequence[str], measured: Sequence[Timing]) -> Table:
    table = Table("joint", "latency ms", "backlash deg", "residual deg", "frames", "rejected")
    for row in _rows(names, measured):
        late, play = row["latency_s"], row["backlash_deg"]
        table.add_row(
            row["joint"],
            f"{1e3 * late['value']:.1f} ± {1e3 * late['margin']:.1f}",
            f"{play['value']:.2f} ± {play['margin']:.2f}",
            f"{row['residual_deg']:.3f}",
            str(row["frames"]),
            str(row["rejected"]),
        )
    return table
