"""`viewsep watch`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from viewsep.cli.console import people
from viewsep.cli.follow import exit_code, heard_ctrl_c, print_line, show_in, tell_result
from viewsep.cli.live import LiveTable
from viewsep.cli.service_options import AnswerTimeout, Certificate, Connect, KeysFolder, Rig, make_client
from viewsep.client import Client, NoAnswer, Received, Stream
from viewsep.errors import ViewsepError
from viewsep.service.status import ResultStatus


def watch(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON line per message, then the result.")] = False,
) -> None:
    """Watch the running task to its end, then say how it ended; of no running one, how the last one ended.

    On terminals it draws the candidates as they are judged. Ctrl-C leaves the task running.

    Exit codes: 0 identified, 1 no task or no answer, 2 bad input, 3 undecided, 4 failed, 6 unknown: none of the
    candidates, 7 indistinguishable: one of several that no view this rig can show tells apart, 130 interrupted.

    Examples:

        viewsep watch

        viewsep start && viewsep watch --json
    """
    with (
        make_client(rig, connect, keys, certificate, timeout_s) as client,
        client.watch() as stream,  # listening before asking, so that nothing is missed
        LiveTable() as table,
        heard_ctrl_c() as pressed,
    ):
        result = _result(client, stream, print_line if json else show_in(table), pressed)
        lost = stream.gaps
    if lost:
        people.print(f"{lost} messages were lost on the way", highlight=False)
    tell_result(result, json, line=json)
    raise typer.Exit(exit_code(result))


def _result(
    client: Client, stream: Stream, heard: Callable[[Received], None], pressed: Callable[[], bool]
) -> ResultStatus:
    engine = client.status().engine
    if engine is None:
        raise NoAnswer(f"no answer from the engine of rig {client.rig!r}: not running, or not allowed")
    if engine.task:
        return client.wait(engine.task, heard=heard, stream=stream, interrupted=pressed)
    if engine.result is None:
        raise ViewsepError(f"no task has run on rig {client.rig!r} yet: `viewsep start` starts one")
    return engine.result
