"""`viewsep bench looks`."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from viewsep.bench.baselines import check_baselines
from viewsep.bench.experiment import run_looks
from viewsep.bench.methods import ALL_MEASURES, methods_for
from viewsep.bench.setup import Setup
from viewsep.cli import bench_options as options
from viewsep.cli import bench_tasks as asking
from viewsep.cli.console import progress_bar, results

BESIDE = "nearest,vote,sift"


def looks(
    pairs: asking.PairsFile = None,
    objects: asking.ObjectsFolder = None,
    twins: asking.Twins = None,
    runs: asking.Runs = 100,
    looks: Annotated[int, typer.Option(min=1, max=1000, help="Looks of every task.")] = 8,
    seed: options.Seed = 0,
    candidates: asking.Candidates = 2,
    interpreter: Annotated[str, typer.Option(help="Interpreters to compare, by name, comma-separated.")] = "filter",
    baselines: Annotated[str, typer.Option(help="Baselines to compare, of nearest, vote, sift.")] = BESIDE,
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
    """Measure who is right after how many looks: interpreters and baselines on the same pictures of a fixed sweep.

    Nobody chooses views and nobody may decline: after every look the most probable candidate, or the one a baseline
    scores highest, is the answer; equal scores are no answer.

    Examples:

        viewsep bench looks --objects photos --every 9 --candidates 12 --runs 48

        viewsep bench looks --pairs objects/pairs.csv --looks 16 --json looks.json --plot pictures
    """
    settings = options.configured(config, rig, disturb, descriptor)
    asked = asking.asked(pairs, objects, twins, runs, seed, candidates, 0.0)
    methods = methods_for(settings, options.listed(interpreter, "--interpreter"), [], [ALL_MEASURES])
    beside = options.listed(baselines, "--baselines") if baselines else []
    check_baselines(beside)
    about = asked.about | asking.learned(asked.pool, views, every, turned, settings) | {"looks": looks}
    options.check_plot(plot)
    with progress_bar() as bars:
        setup = Setup(views, every, options.cache_of(cache, cache_mb), turned)
        running = options.running(jobs, scheduler, json, resume, bars)
        found = run_looks(asked.tasks, methods, beside, looks, setup, running, about)
    if plot:
        from viewsep.plots.looks import draw_looks  # matplotlib is slow to import

        draw_looks(found, plot)
    _tell(found["after"])


def _tell(after: dict[str, list[dict[str, Any]]]) -> None:
    """Right ones by method and number of looks."""
    count = len(next(iter(after.values())))
    table = Table("method", *(str(look) for look in range(1, count + 1)), title="right after so many looks")
    for name, figures in after.items():
        table.add_row(name, *(f"{each['right']}/{each['tasks']}" for each in figures))
    results.print(table)
    main, *others = after
    for name in others:
        for look, each in enumerate(after[name], start=1):
            if each["p"] < 0.05:
                results.print(
                    f"after {look}: {main} right where {name} is not: {each['only_first']}, the reverse: "
                    f"{each['only_this']} (McNemar p = {each['p']:.2g})",
                    highlight=False,
                )
