"""`viewsep demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import MAX_SEED, progress_bar, results
from viewsep.cli.live import LiveTable
from viewsep.cli.separate import exit_code, tell
from viewsep.config import Config
from viewsep.learning import learn_objects, names_for
from viewsep.models import library
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.task import Task, run_task


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for models, recording and picture.")] = Path(
        "demo"
    ),
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the two products and of the task.")] = 7,
) -> None:
    """The main job in one go: two look-alike boxes that differ in one face; learn, separate, record, replay, picture.

    Examples:

        viewsep demo

        viewsep demo --seed 12 -o /tmp/demo
    """
    sources = [f"generated:{seed}", f"generated:{seed}:twin=face"]
    truth = seed % 2
    config = Config()
    names = names_for(sources, None)
    with progress_bar() as progress:
        bar = progress.add_task("learning two generated boxes", total=2)
        learned = {}
        for model in learn_objects(sources, names, 100, config):
            library.save(model, output / "library")
            learned[model.name] = model
            progress.advance(bar)
    models = [learned[name] for name in names]
    results.print(f"Learned {names[0]} and {names[1]}: 100 views each. The simulated rig now holds {names[truth]}.")
    record, picture = output / "demo.mcap", output / "report.png"
    with LiveTable(names[truth]) as table:
        answer = run_task(Task(sources[truth], names[truth], seed, record, overwrite=True), config, models, [table])
    tell(answer)
    content = read_recording(record)
    found = verify(content)
    results.print(f"replay: {found.outputs} outputs of {found.events} events repeated byte for byte", highlight=False)
    from viewsep.plots.report import report  # matplotlib is slow to import

    report(content, picture)
    results.print(f"picture: {picture}", soft_wrap=True)
    raise typer.Exit(exit_code(answer))
