"""`viewsep bench scale`."""

from __future__ import annotations

from json import dumps
from typing import Annotated

import typer
from rich.table import Column, Table

from viewsep import __version__
from viewsep.bench.methods import methods_for
from viewsep.bench.scale import measure_scale
from viewsep.bench.setup import Setup
from viewsep.cli import bench_options as options
from viewsep.cli import bench_tasks as asking
from viewsep.cli.console import progress_bar, results
from viewsep.errors import BadInput
from viewsep.files import write_whole

COUNTS = "2,10,30,100,300,1000"


def scale(
    counts: Annotated[str, typer.Option(help="Numbers of candidates, comma-separated.")] = COUNTS,
    runs: Annotated[int, typer.Option(min=1, help="Sweeps with each number, of different objects in turn.")] = 2,
    looks: Annotated[int, typer.Option(min=1, max=10_000, help="Looks of a sweep.")] = 40,
    seed: options.Seed = 0,
    interpreter: Annotated[str, typer.Option(help="Interpreters, by name, comma-separated.")] = "filter",
    planner: Annotated[
        str | None,
        typer.Option(help="Planners, by name, comma-separated.", show_default="information; separating for path"),
    ] = None,
    disturb: options.Disturb = None,
    rig: options.Preset = None,
    descriptor: options.DescriptorName = None,
    views: asking.Views = 100,
    config: options.ConfigFile = None,
    jobs: options.Jobs = -1,
    json: options.JsonFile = None,
    plot: options.PlotFolder = None,
    cache: options.CacheFolder = None,
    cache_mb: options.CacheSize = options.CACHE_MB,
) -> None:
    """Measure what a step of the engine costs with more and more candidates: generated boxes, one core.

    Learning uses --jobs processes; its time per object is that of one, and short where pictures are in the cache
    already. Interpretation and planning are timed apart, on percepts of a sweep that were made before.

    Examples:

        viewsep bench scale --counts 2,10,30

        viewsep bench scale --json scale.json --plot pictures
    """
    settings = options.configured(config, rig, disturb, descriptor)
    interpreters, planners = options.listed(interpreter, "--interpreter"), options.listed(planner, "--planner")
    methods = methods_for(settings, interpreters, planners, [])
    numbers = _counts(counts)
    options.check_plot(plot)
    with progress_bar() as bars:
        running = options.running(jobs, "", json, False, bars)
        setup = Setup(views, cache=options.cache_of(cache, cache_mb))
        found = measure_scale(numbers, methods, setup, seed, runs, looks, running.workers, running.progress)
    about = {"counts": numbers, "seed": seed, "views": views, "config": settings.model_dump(mode="json")}
    found = {"kind": "scale", "software": f"viewsep {__version__}", "about": about, **found}
    if json:
        write_whole(json, dumps(found, indent=1, allow_nan=False).encode(), "result")
    if plot:
        from viewsep.plots.scale import draw_scale  # matplotlib is slow to import

        draw_scale(found, plot)
    table = Table(Column("method", no_wrap=True), "known", "build s", "look ms", "p95", "plan ms", "p95", "MB", "first")
    for row in found["rows"]:
        table.add_row(
            row["method"],
            str(row["candidates"]),
            f"{row['build_s']:.2f}",
            *(f"{row[f'{what}_ms_{which}']:.2f}" for what in ("interpret", "plan") for which in ("median", "p95")),
            f"{row['engine_mb']:.0f}",
            f"{row['first']}/{row['runs']}",
        )
    results.print(table)
    learning = found["learning"]
    results.print(
        f"learning: {learning['wall_s_median']:.2f} s an object (median of {learning['objects']:.0f}); MB: what the "
        "engine added to its process; first: sweeps that ended with the truth ahead of all others",
        style="dim",
    )


def _counts(text: str) -> list[int]:
    """Rising numbers of candidates. Raises BadInput."""
    try:
        numbers = [int(part) for part in options.listed(text, "--counts")]
    except ValueError:
        raise BadInput(f"--counts {text!r}: write whole numbers separated by commas, such as {COUNTS}") from None
    if min(numbers) < 2 or max(numbers) > 100_000:
        raise BadInput(f"--counts {text!r}: there is nothing to separate below 2 candidates; give 2 to 100000")
    return sorted(set(numbers))
