"""`viewsep bench chain`."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from viewsep.cli import bench_options as options
from viewsep.cli import bench_tasks as asking
from viewsep.cli.bench_options import listed
from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.errors import BadInput


class Who(StrEnum):
    """The candidates of a task."""

    ALL = "all"
    PAIR = "pair"


def chain(
    pairs: asking.PairsFile = None,
    twins: asking.Twins = None,
    generated: Annotated[int, typer.Option(min=1, max=50, help="Generated pairs, without --pairs.")] = 3,
    runs: Annotated[int, typer.Option(min=1, help="Tasks on each rig; pairs and truths take turns.")] = 60,
    rigs: Annotated[str, typer.Option(help="Rigs, comma-separated: turntable, pan_tilt.")] = "turntable,pan_tilt",
    candidates: Annotated[Who, typer.Option(help="All objects that were learned, or the two look-alikes.")] = Who.ALL,
    spacing: Annotated[
        float, typer.Option(min=2.0, max=60.0, help="Widest angle between views that are learned, degrees.")
    ] = 10.0,
    trials: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Further photos between them, as a share of the views.")
    ] = 1.5,
    speed: Annotated[
        float, typer.Option(min=0.1, max=20.0, help="Seconds of the emulated servos per second, as the computer can.")
    ] = 1.0,
    servos: Annotated[
        bool, typer.Option("--servos/--no-servos", help="Emulated servos turn the plate; without, it is simulated.")
    ] = True,
    folder: Annotated[
        Path | None, typer.Option(help="Keep photos and the empty rig here.", show_default="thrown away")
    ] = None,
    seed: options.Seed = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures and every task as JSON.")] = False,
) -> None:
    """Measure all of it together: no mask and no pose is given, the camera sees desk, plate and shadow.

    The empty rig is captured, every object is learned on the rig, put back as it happens, and told from the others. On
    a turntable of emulated servos objects stand, at unknown angles; on pan and tilt they are held in unknown rotations,
    and learned in two placements that are merged.

    Examples:

        viewsep bench chain --pairs pairs.csv --json

        viewsep bench chain --generated 1 --runs 4 --rigs turntable --no-servos
    """
    from viewsep.bench.chain import PLACEMENTS, RIGS, Chain, chain_config, run_chain
    from viewsep.bench.summary import summarise
    from viewsep.bench.tasks import TWINS, draw_tasks, generated_pairs, pairs_from, pool_of

    wanted = [rig for rig in RIGS if rig in listed(rigs, "--rigs")]
    if unknown := set(listed(rigs, "--rigs")) - set(RIGS):
        raise BadInput(f"--rigs {sorted(unknown)[0]!r}: choose from {', '.join(RIGS)}")
    if pairs is not None and twins is not None:
        raise BadInput("--twins generates objects: leave out --pairs")
    if twins is not None and twins not in TWINS:
        raise BadInput(f"--twins {twins!r} is none of {', '.join(TWINS)}: choose one")
    look_alikes = pairs_from(pairs) if pairs else generated_pairs(twins or TWINS[0], seed)[:generated]
    pool = pool_of(look_alikes)
    tasks = draw_tasks(look_alikes, pool, runs, seed, len(pool) if candidates is Who.ALL else 2)
    told: dict[str, Any] = {}
    with ExitStack() as stack, progress_bar() as bars:
        base = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="viewsep-chain-")))
        for rig in wanted:
            place = base / rig
            place.mkdir(parents=True, exist_ok=True)
            config = chain_config(rig, place / "background.npz", speed, servos=servos)
            heard = partial(bars.advance, bars.add_task(rig, total=len(pool) + len(tasks)))
            run = run_chain(Chain(config, place, seed, PLACEMENTS[rig], spacing, trials), tasks, heard)
            told[rig] = run.as_row() | {"figures": summarise(run.rows), "config": config.model_dump(mode="json")}
    if json:
        about = {
            "objects": pool,
            "runs": runs,
            "seed": seed,
            "candidates": candidates.value,
            "spacing_deg": spacing,
            "trials": trials,
        }
        print_json({**about, "rigs": told})
        return
    results.print(_table(told))
    for name, said in told.items():
        views = ", ".join(f"{one['name']} {one['views']}" for one in said["learned"])
        people.print(f"{name}: {said['empty_pictures']} pictures of the empty rig; views: {views}", soft_wrap=True)


def _table(told: dict[str, Any]) -> Table:
    table = Table(
        "rig", "tasks", "right (95 %)", "wrong (95 %)", "undecided", "others", "looks", "travel deg", "pose deg"
    )
    for rig, said in told.items():
        row = said["figures"]
        others = row["unknown"] + row["indistinguishable"] + row["failed"]
        table.add_row(
            rig,
            str(row["n"]),
            _share(row, "right"),
            _share(row, "wrong"),
            str(row["undecided"]),
            str(others),
            *(f"{row[key]:.0f}" if row[key] is not None else "-" for key in ("looks_median", "travel_deg_median")),
            "-" if row["pose_error_deg_median"] is None else f"{row['pose_error_deg_median']:.1f}",
        )
    return table


def _share(row: dict[str, Any], verdict: str) -> str:
    low, high = row[f"{verdict}_wilson95"]
    return f"{row[verdict]} ({low:.1%}-{high:.1%})"
