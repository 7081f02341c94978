"""`viewsep bench pose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.bench.experiment import run_pose
from viewsep.bench.pose import SEED_SECTIONS, pose_methods, pose_runs
from viewsep.bench.setup import Setup
from viewsep.bench.tasks import generated_objects, objects_in
from viewsep.cli import bench_options as options
from viewsep.cli.bench_tables import tell_pose
from viewsep.cli.console import progress_bar
from viewsep.planning.exploration import Exploration


def pose(
    objects: Annotated[
        Path | None, typer.Option(help="Folder of meshes, one folder each.", show_default="generated boxes")
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Runs; the objects take turns.")] = 100,
    seed: options.Seed = 0,
    exploration: Annotated[
        Exploration, typer.Option(help="How the object is turned: spherical (the seed's) or geodesic.")
    ] = "spherical",
    disturb: options.Disturb = None,
    rig: options.Preset = None,
    views: Annotated[int, typer.Option(min=12, max=2000, help="Views of a model.")] = 100,
    config: options.ConfigFile = None,
    jobs: options.Jobs = -1,
    scheduler: options.Scheduler = "",
    json: options.JsonFile = None,
    plot: options.PlotFolder = None,
    resume: options.Resume = False,
    cache: options.CacheFolder = None,
    cache_mb: options.CacheSize = options.CACHE_MB,
) -> None:
    """Measure how accurate poses are (the seed's section V.A), for every variant and alignment on the same views.

    A pose is right when it is less than a node spacing (22.6 deg) off, and failed when it has not converged within
    the limit of looks; its error counts all the same. The seed's descriptor (cch) makes the features, unless the
    configuration names another one.

    Examples:

        viewsep bench pose --runs 20

        viewsep bench pose --objects objects/ycb --disturb light=0.3,noise=0.05 --json pose.json --plot pictures
    """
    settings = options.configured(config, rig, disturb, usual=SEED_SECTIONS)
    sources = objects_in(objects) if objects else generated_objects(seed)
    about = {
        "objects": sources,
        "runs": runs,
        "seed": seed,
        "exploration": exploration,
        "views": views,
        "config": settings.model_dump(mode="json"),
    }
    options.check_plot(plot)
    with progress_bar() as bars:
        report = run_pose(
            pose_runs(sources, runs, seed),
            pose_methods(settings),
            exploration,
            Setup(views=views, cache=options.cache_of(cache, cache_mb)),
            options.running(jobs, scheduler, json, resume, bars),
            about,
        )
    if plot:
        from viewsep.plots.bench import draw_pose  # matplotlib is slow to import

        draw_pose(report, plot)
    tell_pose(report)
