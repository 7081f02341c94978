"""`viewsep separate`."""

from __future__ import annotations

import signal
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.markup import escape

from viewsep.account import Account
from viewsep.bench.methods import usual_planner
from viewsep.built_rig import PictureKind
from viewsep.cli.candidates import candidate_names
from viewsep.cli.console import MAX_SEED, people, print_json, results
from viewsep.cli.exit_codes import EXIT_CODES, EXIT_INTERRUPTED, EXIT_WRONG
from viewsep.cli.live import LiveTable
from viewsep.cli.task_options import PoseTolerance, check_pose_tolerance
from viewsep.config import Config, InterpreterConfig, PlannerConfig, load_config
from viewsep.messages import Outcome
from viewsep.models.library import load_library
from viewsep.session import Session
from viewsep.task import Answer, Task, held_object, run_task


def separate(
    models: Annotated[Path, typer.Option(help="Library folder.", show_default=False)],
    config: Annotated[Path | None, typer.Option(help="TOML configuration; see docs/config.")] = None,
    truth: Annotated[str | None, typer.Option(help="Candidate that the simulated rig holds.")] = None,
    source: Annotated[str | None, typer.Option("--object", help="Any object for the simulated rig to hold.")] = None,
    candidates: Annotated[str | None, typer.Option(help="Comma-separated names.", show_default="all models")] = None,
    interpreter: Annotated[str | None, typer.Option(help="Interpreter by name.", show_default="filter")] = None,
    planner: Annotated[
        str | None, typer.Option(help="Planner by name.", show_default="information; separating for path")
    ] = None,
    pose_tolerance: PoseTolerance = None,
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of grasp, start view, direction and disturbances.")
    ] = 0,
    record: Annotated[Path | None, typer.Option(help="Record the task to this MCAP file.")] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Turn the object until one candidate stands out, and say which it is.

    With a real camera (camera.source = "v4l2") neither --truth nor --object is given; models that were learned on a
    simulated rig need both.

    Exit codes: 0 identified, 2 bad input, 3 undecided, 4 failed, 5 the answer is wrong: it is what --truth says, 6
    unknown: none of the candidates, 7 indistinguishable: one of several that no view this rig can show tells apart, 130
    interrupted.

    Examples:

        viewsep separate --models library --truth tea --seed 1

        viewsep separate --models library --truth tea --interpreter filter --pose-tolerance 5

        viewsep separate --models library --truth tea --config turntable.toml --record run.mcap --json
    """
    settings = _chosen(load_config(config) if config else Config(), interpreter, planner, pose_tolerance)
    known = load_library(models, candidate_names(candidates))
    held, name = held_object(known, truth, source, settings)
    task = Task(held, name, seed, record, force)
    interrupted: list[int] = []
    with LiveTable(name) as table:
        answer = run_task(task, settings, known, [table], lambda session: _cancel_on_interrupt(session, interrupted))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if answer.pictures is PictureKind.LEARNED_PHOTOS:
        people.print(f"note: no photos were left out of the model, so the rig showed {answer.pictures}")
    if settings.task.pose_tolerance_deg is not None and answer.result.pose_spread_rad is None:
        people.print(
            f"note: interpreter {settings.interpreter.name} does not know how well the pose is known: the pose "
            "tolerance changed nothing"
        )
    if json:
        print_json(answer.as_dict())
    else:
        tell(answer)
    if interrupted:
        raise typer.Exit(EXIT_INTERRUPTED)
    raise typer.Exit(exit_code(answer))


def _chosen(settings: Config, interpreter: str | None, planner: str | None, pose_tolerance: float | None) -> Config:
    """The settings with what the options say instead. Raises BadInput."""
    changes: dict[str, object] = {}
    if interpreter and interpreter != settings.interpreter.name:  # options in the file are those of another one
        changes["interpreter"] = InterpreterConfig(name=interpreter)
    planner = planner or usual_planner(settings, interpreter or settings.interpreter.name)
    if planner != settings.planner.name:
        changes["planner"] = PlannerConfig(name=planner)
    if pose_tolerance is not None:
        tolerance = check_pose_tolerance(pose_tolerance)
        changes["task"] = settings.task.model_copy(update={"pose_tolerance_deg": tolerance})
    return settings.model_copy(update=changes)


def exit_code(answer: Answer) -> int:
    """That of the outcome; 5 where the answer is known to be wrong."""
    return EXIT_WRONG if _is_wrong(answer) else EXIT_CODES[answer.result.outcome]


def _is_wrong(answer: Answer) -> bool:
    """A name is judged by the truth only: without one, another file may be of the same object."""
    return answer.correct is False and bool(answer.task.truth or answer.result.outcome is Outcome.UNKNOWN)


def tell(answer: Answer) -> None:
    """The answer as sentences."""
    said, account = answer.as_dict(), Account.of(answer.result)
    begins = f"It is [bold]{escape(account.answer)}[/bold]" if account.answer else f"[bold]{account.outcome}[/bold]"
    results.print(f"{begins}{_verdict(answer)}: {escape(account.grounds)}.", soft_wrap=True)
    pose = f", {account.pose}" if account.pose else ""
    pose += "" if said["pose_error_deg"] is None else f", pose error {said['pose_error_deg']:.1f}°"
    results.print(
        f"{said['looks']} looks, {said['travel_deg']:.0f}° of travel, {said['comparisons']} comparisons{pose} "
        f"({answer.rig})",
        highlight=False,
    )
    if said["recording"]:
        results.print(f"recording: {said['recording']}", soft_wrap=True)


def _verdict(answer: Answer) -> str:
    """Whether that is so, where it is known."""
    if _is_wrong(answer):
        return f" (wrong: it is {answer.task.truth or 'one of them'})"
    unknown = answer.result.outcome is Outcome.UNKNOWN
    return " (right)" if answer.correct and (answer.task.truth or unknown) else ""


def _cancel_on_interrupt(session: Session, interrupted: list[int]) -> None:
    """The first Ctrl-C ends the task in good order, the second one at once."""

    def handle(number: int, _frame: FrameType | None) -> None:
        if interrupted:
            raise KeyboardInterrupt
        interrupted.append(number)
        session.cancel("Ctrl-C")

    signal.signal(signal.SIGINT, handle)
