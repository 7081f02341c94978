"""`viewsep separate`."""

from __future__ import annotations

import signal
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from viewsep.cli.candidates import candidate_names
from viewsep.cli.console import MAX_SEED, people, print_json, results
from viewsep.cli.exit_codes import EXIT_CODES, EXIT_INTERRUPTED, EXIT_WRONG
from viewsep.cli.live import LiveTable
from viewsep.config import Config, InterpreterConfig, load_config
from viewsep.models.library import load_library
from viewsep.rigs import PictureKind
from viewsep.session import Session
from viewsep.task import Answer, Task, held_object, run_task


def separate(
    models: Annotated[Path, typer.Option(help="Library folder.", show_default=False)],
    config: Annotated[Path | None, typer.Option(help="TOML configuration; see docs/config.")] = None,
    truth: Annotated[str | None, typer.Option(help="Candidate that the simulated rig holds.")] = None,
    source: Annotated[str | None, typer.Option("--object", help="Any object for the simulated rig to hold.")] = None,
    candidates: Annotated[str | None, typer.Option(help="Comma-separated names.", show_default="all models")] = None,
    interpreter: Annotated[str | None, typer.Option(help="Interpreter by name.", show_default="path")] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of grasp, start view, direction and disturbances.")
    ] = 0,
    record: Annotated[Path | None, typer.Option(help="Record the task to this MCAP file.")] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Turn the object until one candidate stands out, and say which it is.

    Exit codes: 0 identified, 3 undecided, 4 failed, 5 identified but not as --truth, 2 bad input, 130 interrupted.

    Examples:

        viewsep separate --models library --truth tea --seed 1

        viewsep separate --models library --truth tea --config turntable.toml --record run.mcap --json
    """
    settings = load_config(config) if config else Config()
    if interpreter and interpreter != settings.interpreter.name:  # options in the file are those of another one
        settings = settings.model_copy(update={"interpreter": InterpreterConfig(name=interpreter)})
    known = load_library(models, candidate_names(candidates))
    held, name = held_object(known, truth, source)
    task = Task(held, name, seed, record, force)
    interrupted: list[int] = []
    with LiveTable(name) as table:
        answer = run_task(task, settings, known, [table], lambda session: _cancel_on_interrupt(session, interrupted))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if answer.pictures is PictureKind.LEARNED_PHOTOS:
        people.print(f"note: no photos were left out of the model, so the rig showed {answer.pictures}")
    if json:
        print_json(answer.as_dict())
    else:
        tell(answer)
    if interrupted:
        raise typer.Exit(EXIT_INTERRUPTED)
    raise typer.Exit(exit_code(answer))


def exit_code(answer: Answer) -> int:
    """0 identified, 3 undecided, 4 failed, 5 identified wrongly."""
    if answer.task.truth and answer.correct is False:
        return EXIT_WRONG
    return EXIT_CODES[answer.result.outcome]


def tell(answer: Answer) -> None:
    """The answer as sentences."""
    said = answer.as_dict()
    if answer.result.object:
        verdict = {True: " (right)", False: f" (wrong: it is {answer.task.truth})", None: ""}[
            answer.correct if answer.task.truth else None
        ]
        results.print(f"It is [bold]{answer.result.object}[/bold]{verdict}: {answer.result.reason}.", soft_wrap=True)
    else:
        results.print(f"[bold]{answer.result.outcome.value}[/bold]: {answer.result.reason}.", soft_wrap=True)
    pose = "" if said["pose_error_deg"] is None else f", pose error {said['pose_error_deg']:.1f}°"
    results.print(
        f"{said['looks']} looks, {said['travel_deg']:.0f}° of travel, {said['comparisons']} comparisons{pose} "
        f"({answer.rig})",
        highlight=False,
    )
    if said["recording"]:
        results.print(f"recording: {said['recording']}", soft_wrap=True)


def _cancel_on_interrupt(session: Session, interrupted: list[int]) -> None:
    """The first Ctrl-C ends the task in good order, the second one at once."""

    def handle(number: int, _frame: FrameType | None) -> None:
        if interrupted:
            raise KeyboardInterrupt
        interrupted.append(number)
        session.cancel("Ctrl-C")

    signal.signal(signal.SIGINT, handle)
