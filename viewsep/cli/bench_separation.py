"""`viewsep bench separation`."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep.bench.baselines import check_baselines
from viewsep.bench.experiment import run_separation
from viewsep.bench.methods import MEASURES, PATH, RANDOM_MOTION, methods_for, random_motion
from viewsep.bench.setup import Setup
from viewsep.cli import bench_options as options
from viewsep.cli import bench_tasks as asking
from viewsep.cli.bench_tables import tell_separation
from viewsep.cli.console import progress_bar
from viewsep.errors import BadInput


def separation(
    pairs: asking.PairsFile = None,
    objects: asking.ObjectsFolder = None,
    twins: asking.Twins = None,
    runs: asking.Runs = 100,
    seed: options.Seed = 0,
    candidates: asking.Candidates = 2,
    unknown_fraction: asking.UnknownFraction = 0.0,
    interpreter: Annotated[
        str | None, typer.Option(help="Interpreters to compare, by name, comma-separated.", show_default="filter")
    ] = None,
    planner: Annotated[
        str | None,
        typer.Option(
            help="Planners to compare, by name, comma-separated.", show_default="information; separating for path"
        ),
    ] = None,
    measures: Annotated[
        str | None,
        typer.Option(
            help="What may rate path hypotheses; several are compared, the first one counts.",
            show_default=",".join(MEASURES),
        ),
    ] = None,
    baselines: Annotated[
        str | None,
        typer.Option(
            help="Beside them: nearest, vote, sift (as many looks on a fixed sweep), random (motion).",
            show_default="none",
        ),
    ] = None,
    disturb: options.Disturb = None,
    rig: options.Preset = None,
    descriptor: options.DescriptorName = None,
    pose_tolerance: options.PoseTolerance = None,
    views: asking.Views = 100,
    every: asking.Every = 4,
    turned: asking.Turned = False,
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

    Every method does the same seeded tasks; the first one is tested against each other one (McNemar). Of identical
    twins (--twins none) it is right to say that they are indistinguishable, and wrong to name one.

    Examples:

        viewsep bench separation --runs 20

        viewsep bench separation --pairs objects/pairs.csv --runs 200 --json result.json --plot pictures

        viewsep bench separation --objects photos --every 4 --candidates 12 --baselines nearest,sift

        viewsep bench separation --interpreter filter,path --measures w0+w1+w2

        viewsep bench separation --twins none --runs 20

        viewsep bench separation --candidates 4 --unknown-fraction 0.3
    """
    settings = options.configured(config, rig, disturb, descriptor, pose_tolerance)
    asked = asking.asked(pairs, objects, twins, runs, seed, candidates, unknown_fraction)
    interpreters = options.listed(interpreter, "--interpreter")
    if measures is not None and PATH not in (interpreters or [settings.interpreter.name]):
        raise BadInput(f"--measures {measures!r} is about path hypotheses: add --interpreter path, or leave it out")
    methods = methods_for(
        settings,
        interpreters,
        options.listed(planner, "--planner"),
        options.listed(measures, "--measures") or MEASURES,
    )
    beside = options.listed(baselines, "--baselines")
    if RANDOM_MOTION in beside:
        beside.remove(RANDOM_MOTION)
        methods.append(random_motion(methods[0]))
    check_baselines(beside)
    about = asked.about | asking.learned(asked.pool, views, every, turned, settings)
    options.check_plot(plot)
    with progress_bar() as bars:
        report = run_separation(
            asked.tasks,
            methods,
            beside,
            Setup(views, every, options.cache_of(cache, cache_mb), turned),
            options.running(jobs, scheduler, json, resume, bars),
            about,
        )
    if plot:
        from viewsep.plots.bench import draw_separation  # matplotlib is slow to import

        draw_separation(report, plot)
    tell_separation(report)
