"""`viewsep bench separation`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.bench.baselines import check_baselines
from viewsep.bench.experiment import run_separation
from viewsep.bench.methods import MEASURES, RANDOM_MOTION, methods_for, random_motion
from viewsep.bench.setup import Setup
from viewsep.bench.tasks import TWINS, Pair, draw_tasks, generated_pairs, objects_in, pairs_from, pool_of
from viewsep.cli import bench_options as options
from viewsep.cli.bench_tables import tell_separation
from viewsep.cli.console import progress_bar
from viewsep.errors import BadInput
from viewsep.sim.view_set import is_view_set


def separation(
    pairs: Annotated[
        Path | None, typer.Option(help="CSV with columns a,b: look-alikes, as paths relative to the file.")
    ] = None,
    objects: Annotated[
        Path | None, typer.Option(help="Folder of objects: meshes or view sets, one folder each.")
    ] = None,
    twins: Annotated[
        str | None, typer.Option(help=f"Generated boxes and their twins: {', '.join(TWINS)}.", show_default="face")
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Tasks; pairs and truths take turns.")] = 100,
    seed: options.Seed = 0,
    candidates: Annotated[int, typer.Option(min=2, help="Candidates of a task, the truth among them.")] = 2,
    unknown_fraction: Annotated[
        float, typer.Option(min=0, max=1, help="Share of tasks whose object is no candidate.")
    ] = 0.0,
    interpreter: Annotated[
        str | None, typer.Option(help="Interpreters to compare, by name, comma-separated.", show_default="path")
    ] = None,
    planner: Annotated[
        str | None, typer.Option(help="Planners to compare, by name, comma-separated.", show_default="separating")
    ] = None,
    measures: Annotated[
        str, typer.Option(help="What may rate path hypotheses; several are compared, the first one counts.")
    ] = ",".join(MEASURES),
    baselines: Annotated[
        str | None,
        typer.Option(
            help="Beside them: nearest, vote, sift (as many looks on a fixed sweep), random (motion).",
            show_default="none",
        ),
    ] = None,
    disturb: options.Disturb = None,
    rig: options.Preset = None,
    views: Annotated[int, typer.Option(min=12, max=2000, help="Views of a mesh's model.")] = 100,
    every: Annotated[
        int,
        typer.Option(min=1, help="Every how many photos of a view set one is for the model; the rest are for tests."),
    ] = 4,
    config: options.ConfigFile = None,
    jobs: options.Jobs = -1,
    scheduler: options.Scheduler = "",
    json: options.JsonFile = None,
    plot: options.PlotFolder = None,
    resume: options.Resume = False,
    cache: options.CacheFolder = None,
    cache_mb: options.CacheSize = options.CACHE_MB,
) -> None:
    """Separate look-alikes and count (the seed's section V.B): who is right, how far it drove, what it cost.

    Every method does the same seeded tasks; the first one is tested against each other one (McNemar).

    Examples:

        viewsep bench separation --runs 20

        viewsep bench separation --pairs objects/pairs.csv --runs 200 --json result.json --plot pictures

        viewsep bench separation --objects photos --every 4 --candidates 12 --baselines nearest,sift
    """
    settings = options.configured(config, rig, disturb)
    look_alikes, pool = _objects(pairs, objects, twins, seed)
    tasks = draw_tasks(look_alikes, pool, runs, seed, candidates, unknown_fraction)
    methods = methods_for(
        settings,
        options.listed(interpreter, "--interpreter"),
        options.listed(planner, "--planner"),
        options.listed(measures, "--measures"),
    )
    beside = options.listed(baselines, "--baselines")
    if RANDOM_MOTION in beside:
        beside.remove(RANDOM_MOTION)
        methods.append(random_motion(methods[0]))
    check_baselines(beside)
    about = {
        "objects": pool,
        "runs": runs,
        "seed": seed,
        "candidates": candidates,
        "unknown_fraction": unknown_fraction,
        "views": None if all(is_view_set(Path(source)) for source in pool) else views,
        "every": every,
        "config": settings.model_dump(mode="json"),
    }
    options.check_plot(plot)
    with progress_bar() as bars:
        report = run_separation(
            tasks,
            methods,
            beside,
            Setup(views, every, options.cache_of(cache, cache_mb)),
            options.running(jobs, scheduler, json, resume, bars),
            about,
        )
    if plot:
        from viewsep.plots.bench import draw_separation  # matplotlib is slow to import

        draw_separation(report, plot)
    tell_separation(report)


def _objects(pairs: Path | None, objects: Path | None, twins: str | None, seed: int) -> tuple[list[Pair], list[str]]:
    """Pairs to ask for (none: every object in turn) and all objects. Raises BadInput."""
    if sum(given is not None for given in (pairs, objects, twins)) > 1 and twins is not None:
        raise BadInput("--twins generates objects: leave out --pairs and --objects")
    if twins is not None and twins not in TWINS:
        raise BadInput(f"--twins {twins!r} is none of {', '.join(TWINS)}: choose one")
    if pairs is None and objects is None:
        look_alikes = generated_pairs(twins or TWINS[0], seed)
        return look_alikes, pool_of(look_alikes)
    look_alikes = pairs_from(pairs) if pairs else []
    pool = objects_in(objects) if objects else []
    return look_alikes, sorted({*pool, *pool_of(look_alikes)})
