"""`viewsep learn`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import print_json, progress_bar, results
from viewsep.config import Config, load_config
from viewsep.learning import learn_objects, names_for
from viewsep.models import library


def learn(
    sources: Annotated[
        list[str],
        typer.Argument(
            help="Mesh files (OBJ), folders holding one, folders holding photos and views.csv, or "
            "generated:SEED[:twin=face|sticker|none][:sticker=SHARE].",
            metavar="SOURCE...",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Library folder the models go to.", show_default=False)
    ],
    name: Annotated[
        str | None, typer.Option(help="Name of the object (one source only).", show_default="folder's")
    ] = None,
    views: Annotated[int | None, typer.Option(help="Meshes: views of the model.", show_default="100")] = None,
    every: Annotated[int | None, typer.Option(help="Photos: every K-th of the list.", show_default="all")] = None,
    nodes: Annotated[Path | None, typer.Option(help="Photos: a file that names them, one a line.")] = None,
    config: Annotated[
        Path | None, typer.Option(help="TOML configuration; its camera and descriptor count here.")
    ] = None,
    jobs: Annotated[int, typer.Option(help="Processes; -1 is one per core.")] = -1,
    json: Annotated[bool, typer.Option("--json", help="Print the learned models as JSON.")] = False,
) -> None:
    """Learn objects from renders all around or from photos: views, neighbours, one feature per view.

    Examples:

        viewsep learn boxes/tea boxes/tea_decaf -o library

        viewsep learn generated:7 generated:7:twin=sticker -o library

        viewsep learn photos/tea photos/tea_decaf --every 4 -o library
    """
    settings = load_config(config) if config else Config()
    names = names_for(sources, name)
    learned = []
    with progress_bar() as progress:
        bar = progress.add_task("learning", total=len(sources))
        for model in learn_objects(sources, names, views, settings, jobs, every=every, nodes=nodes):
            path = library.save(model, output)
            learned.append(
                {"name": model.name, "views": len(model.directions), "file": str(path), "hash": model.digest}
            )
            progress.advance(bar)
    learned.sort(key=lambda entry: str(entry["name"]))
    if json:
        print_json(learned)
        return
    for entry in learned:
        results.print(
            f"learned [bold]{entry['name']}[/bold]: {entry['views']} views -> {entry['file']}", soft_wrap=True
        )
