"""`viewsep rigs`."""

from __future__ import annotations

import typer
from rich.table import Table

from viewsep.cli.console import print_json, results
from viewsep.cli.service_options import AnswerTimeout, Certificate, Connect, Json, KeysFolder, endpoints, keys_folder
from viewsep.client import NoAnswer
from viewsep.client import rigs as served_rigs


def rigs(
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    json: Json = False,
) -> None:
    """List the rigs that are served, and which of their roles are alive.

    Exit codes: 0 at least one, 1 none or no answer, 2 bad input.

    Examples:

        viewsep rigs

        viewsep rigs --connect tcp/127.0.0.1:7447 --json
    """
    where = endpoints(connect)
    found = served_rigs(where, keys_folder(keys), certificate, timeout_s)
    if json:
        print_json([{"name": rig.name, "roles": list(rig.roles)} for rig in found])
    elif found:
        table = Table("rig", "roles")
        for rig in found:
            table.add_row(rig.name, " ".join(rig.roles))
        results.print(table)
    if not found and not json:
        raise NoAnswer(f"no rig is served at {', '.join(where)}, or this client is not allowed to see it")
    if not found:
        raise typer.Exit(NoAnswer.exit_code)
