"""`viewsep status`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from rich.console import Group, RenderableType
from rich.live import Live

from viewsep.cli.console import print_json, print_json_line, results
from viewsep.cli.exit_codes import EXIT_INTERRUPTED
from viewsep.cli.service_options import AnswerTimeout, Certificate, Connect, Json, KeysFolder, Rig, make_client
from viewsep.cli.status_tables import tables
from viewsep.client import Client
from viewsep.service.ending import Ending
from viewsep.service.status import Status

REFRESH_S = 0.5


def status(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    json: Json = False,
) -> None:
    """What a rig and its engine say of themselves: joints, camera, task, candidates, recording, faults.

    With --json it prints the schema viewsep.status/1 of docs/service.md; with --watch too, one line per update.

    Exit codes: 0, 1 no answer, 2 bad input, 130 interrupted.

    Examples:

        viewsep status

        viewsep status --rig bench --watch

        viewsep status --json --connect tls/10.0.0.5:7447 --keys ~/keys --as operator
    """
    with make_client(rig, connect, keys, certificate, timeout_s) as client:
        if watch:
            _go_on(client, json)
        elif json:
            print_json(_as_json(client.status()))
        else:
            results.print(_drawn(client.status()))


def _go_on(client: Client, json: bool) -> None:
    """Updates until Ctrl-C or until nobody answers."""
    ending = Ending()
    with ending.while_on_signals(), _shown(json) as show:
        show(client.status())
        while not ending.wait(REFRESH_S):
            show(client.status())
    raise typer.Exit(EXIT_INTERRUPTED)


@contextmanager
def _shown(json: bool) -> Iterator[Callable[[Status], None]]:
    """Where updates go: JSON lines, one table after the other, or on a terminal one that changes."""
    if json:
        yield lambda said: print_json_line(_as_json(said))
    elif not results.is_terminal:
        yield lambda said: results.print(_drawn(said))
    else:
        with Live(console=results, auto_refresh=False) as live:
            yield lambda said: live.update(_drawn(said), refresh=True)


def _as_json(said: Status) -> dict[str, Any]:
    return said.model_dump(mode="json", by_alias=True)


def _drawn(said: Status) -> RenderableType:
    return Group(*tables(said))
