"""`viewsep bench compensation`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from viewsep.bench.compensation import Calibrated, Outcomes, calibrate, outcomes, summed
from viewsep.cli.console import MAX_SEED, print_json, progress_bar, results
from viewsep.config import Config, RigConfig, load_config


def compensation(
    runs: Annotated[int, typer.Option(min=1, help="Tasks, each with a box of its own and its twin.")] = 10,
    latency_ms: Annotated[float, typer.Option(min=0.0, max=300.0, help="How late stamps are.")] = 80.0,
    backlash_deg: Annotated[float, typer.Option(min=0.0, max=8.0, help="Play of every joint.")] = 2.0,
    config: Annotated[Path | None, typer.Option(help="A simulated rig.", show_default="pan_tilt")] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the first task.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Give a simulated rig late stamps and play, calibrate it, and run the same tasks with and without what was found.

    Example:

        viewsep bench compensation --runs 10 --latency-ms 80 --backlash-deg 2
    """
    settings = load_config(config) if config else Config(rig=RigConfig(preset="pan_tilt"))
    late_s = latency_ms / 1000.0
    with progress_bar() as progress:
        bar = progress.add_task("calibrating", total=None)
        found = calibrate(settings, seed, late_s, backlash_deg)
        progress.update(bar, description="separating", total=runs, completed=0)
        ended = []
        for both in outcomes([settings, found.in_config(settings)], range(seed, seed + runs), late_s, backlash_deg):
            ended.append(both)
            progress.advance(bar)
    without, with_it = (summed([both[k] for both in ended]) for k in (0, 1))
    if json:
        print_json(
            {
                "injected": {"latency_ms": latency_ms, "backlash_deg": backlash_deg},
                "found": _found(found),
                "without": _ended(without),
                "with": _ended(with_it),
            }
        )
        return
    table = Table("", "injected", "found", "within")
    for row in _found(found):
        injected = latency_ms if row["unit"] == "ms" else backlash_deg
        table.add_row(f"{row['what']} {row['unit']}", f"{injected:g}", f"{row['value']:.2f}", f"{row['margin']:.2f}")
    results.print(table)
    table = Table("compensation", "right", "wrong", "no answer", "pose error, median deg", "mean deg", "worst deg")
    for name, one in (("without", without), ("with", with_it)):
        row = _ended(one)
        numbers = (row["pose_error_median_deg"], row["pose_error_mean_deg"], row["pose_error_worst_deg"])
        table.add_row(name, str(one.right), str(one.wrong), str(one.open), *(f"{number:.2f}" for number in numbers))
    results.print(table)


def _found(found: Calibrated) -> list[dict[str, Any]]:
    late, sure = 1e3 * found.latency_s.value, 1e3 * found.latency_s.margin
    play = [np.degrees([one.play_rad.value, one.play_rad.margin]).tolist() for one in found.joints]
    return [
        {"what": "latency", "unit": "ms", "value": late, "margin": sure},
        *(
            {"what": f"backlash of joint {number}", "unit": "deg", "value": value, "margin": margin}
            for number, (value, margin) in enumerate(play, 1)
        ),
    ]


def _ended(one: Outcomes) -> dict[str, Any]:
    errors = np.degrees(one.pose_errors_rad) if one.pose_errors_rad else np.array([np.nan])
    return {
        "right": one.right,
        "wrong": one.wrong,
        "no_answer": one.open,
        "pose_error_median_deg": float(np.median(errors)),
        "pose_error_mean_deg": float(errors.mean()),
        "pose_error_worst_deg": float(errors.max()),
    }
