"""`viewsep start`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from viewsep.cli.candidates import candidate_names
from viewsep.cli.console import MAX_SEED, people, print_json
from viewsep.cli.exit_codes import EXIT_INTERRUPTED
from viewsep.cli.follow import exit_code, heard_ctrl_c, print_line, show_in, tell_result
from viewsep.cli.live import LiveTable
from viewsep.cli.service_options import (
    AnswerTimeout,
    Certificate,
    Connect,
    Json,
    KeysFolder,
    Owner,
    Rig,
    make_client,
)
from viewsep.cli.task_options import PoseTolerance, check_pose_tolerance
from viewsep.client import Client, RequestRefused
from viewsep.errors import BadInput

CANCEL_S = 30.0
"""How long a cancelled task may take to end in good order."""


def start(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    candidates: Annotated[str | None, typer.Option(help="Comma-separated names.", show_default="all models")] = None,
    pose_tolerance: PoseTolerance = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the task.")] = 0,
    wait: Annotated[bool, typer.Option("--wait", help="Stay until it has ended; Ctrl-C cancels it.")] = False,
    follow: Annotated[bool, typer.Option("--follow", help="Watch it to its end; Ctrl-C leaves it running.")] = False,
    json: Json = False,
) -> None:
    """Start a task on a served rig.

    Prints the name of the task, which goes on when this command has ended. With --wait the task belongs to this command
    and is stopped should it die; with --follow it is only watched. Both end with the result; --json prints the result
    (--wait) or one line per message and then the result (--follow).

    Exit codes: 0 started, or identified; 1 refused or no answer; 2 bad input; 3 undecided; 4 failed; 6 unknown: none
    of the candidates; 7 indistinguishable: one of several that no view this rig can show tells apart; 130 interrupted.

    Examples:

        viewsep start --candidates tea,tea_decaf --seed 1

        viewsep start --wait --json --pose-tolerance 5

        viewsep start && viewsep watch
    """
    names = candidate_names(candidates)
    tolerance_deg = check_pose_tolerance(pose_tolerance)
    if wait and follow:
        raise BadInput("--wait and --follow exclude each other: leave one out")
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        order = _Order(names, seed, tolerance_deg)
        if wait:
            raise typer.Exit(_wait(client, order, json))
        if follow:
            raise typer.Exit(_follow(client, order, json))
        task = order.start(client, detach=True)
        if json:
            print_json({"accepted": True, "task": task})
        else:
            typer.echo(task)


@dataclass(frozen=True, slots=True)
class _Order:
    """What to start."""

    candidates: list[str]
    seed: int
    pose_tolerance_deg: float | None

    def start(self, client: Client, *, detach: bool) -> str:
        """Start it; the task's name."""
        return client.start(self.candidates, self.seed, detach, self.pose_tolerance_deg)


def _wait(client: Client, order: _Order, json: bool) -> int:
    """Carry out a task of our own. Its exit code, 130 when it was cancelled here."""
    with client.watch() as stream, LiveTable() as table, heard_ctrl_c() as pressed:
        task = order.start(client, detach=False)
        interrupted = False
        try:
            result = client.wait(task, heard=show_in(table), stream=stream, interrupted=pressed)
        except KeyboardInterrupt:  # the first one ends the task in good order, the second one at once
            interrupted = True
            people.print("cancelling; Ctrl-C again stops at once")
            _cancel(client)
            result = client.wait(task, CANCEL_S, show_in(table), stream, pressed)
    tell_result(result, json)
    return EXIT_INTERRUPTED if interrupted else exit_code(result)


def _follow(client: Client, order: _Order, json: bool) -> int:
    """Start a task and watch it to its end."""
    with client.watch() as stream, LiveTable() as table, heard_ctrl_c() as pressed:
        task = order.start(client, detach=True)
        people.print(f"task {task}", highlight=False)
        heard = print_line if json else show_in(table)
        result = client.wait(task, heard=heard, stream=stream, interrupted=pressed)
    tell_result(result, json, line=json)
    return exit_code(result)


def _cancel(client: Client) -> None:
    try:
        client.cancel("Ctrl-C")
    except RequestRefused as refusal:
        people.print(f"{refusal}", highlight=False)  # it has ended by itself just now
