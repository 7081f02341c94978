"""`viewsep learn`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.capture.lesson import Lesson
from viewsep.cli.console import MAX_SEED, print_json, progress_bar, results
from viewsep.cli.learn_rig import learn_on_rig
from viewsep.config import Config, load_config
from viewsep.errors import BadInput
from viewsep.learning import learn_objects, names_for
from viewsep.models import library
from viewsep.models.library import check_name
from viewsep.rigs import is_real


def learn(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            help="Mesh files (OBJ), folders holding one, folders holding photos and views.csv, or "
            "generated:SEED[:twin=face|sticker|none][:sticker=SHARE]; none with --rig.",
            metavar="SOURCE...",
            show_default=False,
        ),
    ] = None,
    *,
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
    rig: Annotated[bool, typer.Option("--rig", help="Learn what the rig holds, from photos taken there.")] = False,
    held: Annotated[
        str | None, typer.Option("--object", help="--rig: what the simulated rig holds.", show_default=False)
    ] = None,
    placement: Annotated[
        int, typer.Option(min=1, max=99, help="--rig: count placements of the object; all together make the model.")
    ] = 1,
    spacing: Annotated[
        float, typer.Option(min=2.0, max=60.0, help="--rig: widest angle between neighbouring views, degrees.")
    ] = 22.5,
    photos: Annotated[
        Path | None, typer.Option(help="--rig: folder the photos are kept in.", show_default="OUTPUT/NAME.photos")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="--rig: seed of the simulated rig.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the learned models as JSON.")] = False,
) -> None:
    """Learn objects from renders all around or from photos: views, neighbours, one feature per view.

    Examples:

        viewsep learn boxes/tea boxes/tea_decaf -o library

        viewsep learn generated:7 generated:7:twin=sticker -o library

        viewsep learn photos/tea photos/tea_decaf --every 4 -o library

        viewsep learn --rig --config rig.toml --name tea --object boxes/tea -o library

        viewsep learn --rig --config rig.toml --name tea --object boxes/tea -o library --placement 2
    """
    settings = load_config(config) if config else Config()
    if rig:
        if sources:
            raise BadInput(f"--rig learns what the rig holds: leave out {sources[0]!r}, or leave out --rig")
        if name is None:
            raise BadInput("--rig needs --name NAME, what the object is called")
        if held is None and not is_real(settings):
            raise BadInput("--rig needs --object SOURCE: the camera is simulated")
        folder = photos or output / f"{check_name(name)}.photos"
        learn_on_rig(Lesson(check_name(name), folder, placement, spacing), settings, output, held or "", seed, json)
        return
    if not sources:
        raise BadInput("give at least one SOURCE to learn from, or --rig to learn what the rig holds")
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
