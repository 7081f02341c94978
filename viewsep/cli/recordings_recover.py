"""`viewsep recordings recover`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from viewsep.cli.console import print_json, progress_bar, results
from viewsep.recordings.recovery import recover as save
from viewsep.recordings.recovery import told


def recover(
    files: Annotated[list[Path], typer.Argument(help="Damaged or unfinished recordings.", metavar="FILE...")],
    json: Annotated[bool, typer.Option("--json", help="Print what was saved and lost as JSON.")] = False,
) -> None:
    """Save what is left of recordings that were cut off or damaged: run.mcap.part goes to run.recovered.mcap.

    The damaged file is never changed; doing it again changes nothing. `viewsep serve` does it by itself for what an
    earlier one left unfinished.

    Exit codes: 0 saved or whole, 2 nothing can be saved.

    Examples:

        viewsep recordings recover run.mcap.part

        viewsep recordings recover recordings/*.part --json
    """
    found: list[dict[str, Any]] = []
    with progress_bar() as progress:
        bar = progress.add_task("recovering", total=len(files))
        for file in files:
            saved = save(file)
            kept = {} if saved is None else {**asdict(saved), "path": str(saved.path)}
            found.append({**kept, "source": str(file), "whole": saved is None})
            if not json:
                for line in told(saved, file):
                    results.print(line, soft_wrap=True, highlight=False)
            progress.advance(bar)
    if json:
        print_json(found)
