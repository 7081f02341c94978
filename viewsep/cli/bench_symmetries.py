"""`viewsep bench symmetries`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from viewsep.bench.setup import Setup
from viewsep.bench.tasks import objects_in
from viewsep.cli import bench_options as options
from viewsep.cli.console import print_json, progress_bar, results


def symmetries(
    objects: Annotated[Path, typer.Option(help="Folder of objects: meshes or view sets, one folder each.")],
    jobs: options.Jobs = -1,
    scheduler: options.Scheduler = "",
    json: Annotated[bool, typer.Option("--json", help="Print the symmetries as JSON.")] = False,
    cache: options.CacheFolder = None,
    cache_mb: options.CacheSize = options.CACHE_MB,
) -> None:
    """List by which turns objects look the same; errors of poses are scored modulo these.

    They are found from pictures of the objects, print included. Photos tell of turns about the vertical only.

    Example:

        viewsep bench symmetries --objects objects/ycb
    """
    from viewsep.bench.experiment import list_symmetries  # scipy's statistics are slow to import

    with progress_bar() as bars:
        run = options.running(jobs, scheduler, None, False, bars)
        rows = list_symmetries(objects_in(objects), Setup(cache=options.cache_of(cache, cache_mb)), run)
    if json:
        print_json({row["name"]: row["turns"] for row in rows})
        return
    table = Table("object", "looks the same after turns by", "poses alike")
    for row in rows:
        turns = [f"{turn['degrees']:g}°" if turn["degrees"] else "any angle" for turn in row["turns"]]
        about = ["({:.2f}, {:.2f}, {:.2f})".format(*turn["axis"]) for turn in row["turns"]]
        listed = "\n".join(f"{turn} about {axis}" for turn, axis in zip(turns, about, strict=True))
        table.add_row(row["name"], listed or "-", row["alike"])
    results.print(table)
