"""`viewsep bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from viewsep.bench.separation import pairs_from, run_separation
from viewsep.bench.speed import measure_speed
from viewsep.cli.console import MAX_SEED, print_json, progress_bar, results
from viewsep.config import Config, load_config

app = typer.Typer(help="Measure the method: how often it is right, what it costs.", no_args_is_help=True)


@app.command()
def speed(
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the objects and tasks.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Time one engine step with two candidates and the descriptor of a 128 x 128 view, on one core.

    Example:

        viewsep bench speed --json
    """
    figures = measure_speed(seed)
    if json:
        print_json(figures)
        return
    table = Table("what", "median ms", "p95 ms", "samples")
    for name, row in figures.items():
        table.add_row(name, f"{row['median_ms']:.2f}", f"{row['p95_ms']:.2f}", f"{row['samples']:.0f}")
    results.print(table)


@app.command()
def separation(
    pairs: Annotated[Path, typer.Option(help="CSV with columns a,b: meshes or folders, relative to the file.")],
    runs: Annotated[int, typer.Option(min=1, help="Tasks; pairs and truths take turns.")] = 90,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the first task; the next ones count up.")] = 0,
    config: Annotated[Path | None, typer.Option(help="TOML configuration.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes; -1 is one per core.")] = -1,
    json: Annotated[Path | None, typer.Option(help="Write tasks and summary to this file.")] = None,
) -> None:
    """Separate look-alike pairs and count (the seed's section V.B).

    Example:

        viewsep bench separation --pairs objects/pairs.csv --runs 90 --json result.json
    """
    settings = load_config(config) if config else Config()
    listed = pairs_from(pairs)
    with progress_bar() as progress:
        bar = progress.add_task("tasks", total=runs)
        outcome = run_separation(listed, runs, seed, settings, jobs, lambda: progress.advance(bar))
    if json:
        outcome.write(json)
    table = Table("figure", "value")
    for name, value in outcome.summary.items():
        text = f"{value[0]:.3f} to {value[1]:.3f}" if isinstance(value, list) else f"{value:g}"
        table.add_row(name, text)
    results.print(table)
    for row in outcome.tasks:
        if not row["correct"]:
            results.print(
                f"seed {row['seed']}: {row['truth']} -> {row['outcome']} {row['object'] or ''}", highlight=False
            )
