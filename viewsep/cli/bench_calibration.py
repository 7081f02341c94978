"""`viewsep bench calibration`."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep.bench.experiment import run_calibration
from viewsep.bench.methods import methods_for
from viewsep.bench.setup import Setup
from viewsep.cli import bench_options as options
from viewsep.cli import bench_tasks as asking
from viewsep.cli.bench_tables import tell_calibration
from viewsep.cli.console import progress_bar


def calibration(
    pairs: asking.PairsFile = None,
    objects: asking.ObjectsFolder = None,
    twins: asking.Twins = None,
    runs: asking.Runs = 100,
    looks: Annotated[int, typer.Option(min=1, max=10_000, help="Looks of every task.")] = 30,
    seed: options.Seed = 0,
    candidates: asking.Candidates = 2,
    unknown_fraction: asking.UnknownFraction = 0.0,
    interpreter: Annotated[str, typer.Option(help="Interpreters with probabilities, comma-separated.")] = "filter",
    planner: Annotated[
        str | None, typer.Option(help="Planners to compare, by name, comma-separated.", show_default="information")
    ] = None,
    disturb: options.Disturb = None,
    rig: options.Preset = None,
    descriptor: options.DescriptorName = None,
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
    """Measure whether probabilities mean what they say, at every look of every task and where one would be decided.

    Nothing ends a task before its last look, unless the planner sees no use in going on. Expected calibration error,
    Brier score and log loss with bootstrap intervals over the tasks; with unknown objects, how well they are noticed.

    Examples:

        viewsep bench calibration --runs 20 --plot pictures

        viewsep bench calibration --candidates 4 --unknown-fraction 0.3 --disturb light=0.3 --json calibration.json
    """
    settings = options.configured(config, rig, disturb, descriptor)
    settings = settings.model_copy(update={"task": settings.task.model_copy(update={"max_looks": looks})})
    asked = asking.asked(pairs, objects, twins, runs, seed, candidates, unknown_fraction)
    interpreters, planners = options.listed(interpreter, "--interpreter"), options.listed(planner, "--planner")
    methods = methods_for(settings, interpreters, planners, [])
    about = asked.about | asking.learned(asked.pool, views, every, turned, settings) | {"looks": looks}
    options.check_plot(plot)
    with progress_bar() as bars:
        report = run_calibration(
            asked.tasks,
            methods,
            Setup(views, every, options.cache_of(cache, cache_mb), turned),
            options.running(jobs, scheduler, json, resume, bars),
            about,
        )
    if plot:
        from viewsep.plots.calibration import draw_calibration  # matplotlib is slow to import

        draw_calibration(report, plot)
    tell_calibration(report)
